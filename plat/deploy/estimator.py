"""State estimation of a legged robot: root pose and velocity from its IMU, its joints and the floor under its feet."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plat.bounds import Bounded, Positive, check_value, is_finite, shown
from plat.deploy.contact_detection import ContactDetector, ContactSettings
from plat.deploy.description import RobotDescription, check_description
from plat.deploy.invariant_filter import FilterNoise, InvariantFilter
from plat.deploy.soles import SoleKinematics
from plat.deploy.state import Array, Pose, RobotState, finite_vector, root_of, unit_quaternion
from plat.errors import StateError
from plat.json_file import short
from plat.rotations_np import axis_rotation, quat_from_matrix, quat_to_matrix

__all__ = ["EstimatorSettings", "StateEstimator"]

_Floats = NDArray[np.float64]
# rad/s: what may be the bias of a gyroscope and the noise of a single reading; a turn that is taken for it is one that
# the estimate makes afterwards
_MOST_BIAS = 0.2
_LEAST_GRAVITY, _MOST_GRAVITY = 7.0, 13.0  # m/s²: what an accelerometer at rest reads


@dataclass(frozen=True)
class EstimatorSettings(Bounded):
    """Settings of the state estimator: what is expected of sensors and floor."""

    noise: FilterNoise = FilterNoise()
    """of the IMU and of slip"""
    contacts: ContactSettings = ContactSettings()
    """of contact detection"""
    joint_pos: Positive = 0.005
    """standard deviation of a joint angle, encoder bias included (rad)"""
    kinematics: Positive = 0.003
    """standard deviation of a point of the sole beside that: links bend, soles give (m)"""
    floor: float | None = 0.0
    """height of a level floor (m, world); None where it is not level or not known"""
    floor_noise: Positive = 0.005
    """standard deviation of that height, averaged over a second (m)"""
    gate: Positive = 12.0
    """largest squared Mahalanobis distance at which a point is believed to stand still"""
    lost: Positive = 0.5
    """doubt of the velocity when no point in contact stands still (m/s/√s)"""
    hanging: Positive = 0.03
    """standard deviation of the velocity of a robot that hangs, averaged over a second (m/s)"""


class StateEstimator:
    """Estimator of the root's pose and velocity in the world: leg odometry and an IMU in an invariant Kalman filter.

    Call :meth:`reset` while the robot stands still, then :meth:`update` with every reading. Its rate should be the
    IMU's, or at least the policy's. Points of the soles that touch are landmarks until they lift or slip, see
    :class:`plat.deploy.InvariantFilter`. Horizontal position and heading drift, for nothing measures them;
    :meth:`anchor` and :meth:`measure` take them from outside.

    Args:
        robot: with its feet.
        settings: what is expected of sensors and floor.
        imu_pos: the IMU's place in the root's frame ``[3]`` (m).
        imu_quat: its orientation ``[4]`` (``wxyz``, IMU to root).

    Raises:
        RobotError: for a description without feet, and for what is none.
        StateError: for a place of the IMU that is none.
        ConfigError: for what are no settings.

    >>> from plat.robots import G1, describe_robot
    >>> robot = describe_robot(G1, control_dt=0.02)
    >>> estimator = StateEstimator(robot)
    >>> still = {"gyro": np.zeros(3), "acceleration": np.array([0.0, 0.0, 9.81])}
    >>> state = estimator.reset(robot.default_joint_pos, **still)
    >>> for _ in range(50):
    ...     state = estimator.update(robot.default_joint_pos, np.zeros(29), **still, dt=0.02)
    >>> state.root_pos_w.round(2).tolist()
    [0.0, 0.0, 0.76]
    """

    def __init__(
        self,
        robot: RobotDescription,
        settings: EstimatorSettings = EstimatorSettings(),
        imu_pos: Array | tuple[float, float, float] = (0.0, 0.0, 0.0),
        imu_quat: Array | tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0),
    ):
        check_description(robot)
        check_value("state estimator: settings", settings, EstimatorSettings)
        self._robot = robot
        self._settings = settings
        self._soles = SoleKinematics(robot)
        self._detector = ContactDetector(robot, settings.contacts)
        self._imu_pos = finite_vector("state estimator: imu_pos", imu_pos, 3)
        self._imu_to_root = quat_to_matrix(unit_quaternion("state estimator: imu_quat", imu_quat))
        self._filter = InvariantFilter(len(self._soles.foot), settings.noise)
        self._standing = np.zeros(len(self._soles.foot), dtype=bool)
        self._before: _Floats | None = None
        self._begun = False
        self._reading = (robot.default_joint_pos, np.zeros(len(robot.joint_names)), np.zeros(3))

    @property
    def contacts(self) -> NDArray[np.bool_]:
        """Return which feet stand on the floor, as :attr:`RobotDescription.feet` are in order."""
        return np.array([self._standing[self._soles.foot == foot].any() for foot in range(len(self._robot.feet))])

    @property
    def position_spread(self) -> _Floats:
        """Return the standard deviation of the root's position ``[3]`` (m, world) that the filter expects."""
        return self._filter.position_spread

    def reset(
        self,
        joint_pos: Array,
        gyro: Array,
        acceleration: Array,
        *,
        root_pos_w: Array | tuple[float, float] = (0.0, 0.0),
        heading: float = 0.0,
    ) -> RobotState:
        """Begin anew with a robot that stands still; return its state.

        The tilt is taken from the accelerometer, the height from the lowest sole on the floor, the bias of the
        gyroscope from what it reads.

        Args:
            joint_pos: joint angles ``[J]`` (rad).
            gyro: angular velocity ``[3]`` (rad/s, IMU), better the mean of a second.
            acceleration: specific force ``[3]`` (m/s², IMU), likewise.
            root_pos_w: x and y of the root (m, world); more numbers are ignored.
            heading: of the root about the vertical (rad, world).

        Raises:
            StateError: for readings of another size, that are not finite, or of a robot that falls or spins.
        """
        joint_pos, gyro, acceleration = self._checked(joint_pos, gyro, acceleration)
        x_w, y_w = _horizontal(root_pos_w)
        if not is_finite(heading):
            raise StateError(f"state estimator: heading is {shown(heading)}, expected a finite angle")
        size, rate = float(np.linalg.norm(acceleration)), float(np.linalg.norm(gyro))
        if not _LEAST_GRAVITY <= size <= _MOST_GRAVITY or rate > _MOST_BIAS:
            raise StateError(
                f"state estimator: {size:.3g} m/s² and {rate:.3g} rad/s at the IMU, expected a robot that stands still "
                "(9.81 and 0)"
            )
        rotation = _upright(self._imu_to_root @ acceleration / size, heading)  # root to world
        points_b, _ = self._soles(joint_pos)
        floor = 0.0 if self._settings.floor is None else self._settings.floor
        height = floor - float((points_b @ rotation.T)[:, 2].min())
        position = np.array([x_w, y_w, height])
        self._filter.reset(rotation @ self._imu_to_root, position + rotation @ self._imu_pos)
        self._filter.gyro_bias = gyro
        self._detector.reset()
        self._standing[:] = False
        self._before = None
        self._begun = True
        return self._state(joint_pos, np.zeros_like(joint_pos), gyro)

    def update(
        self,
        joint_pos: Array,
        joint_vel: Array,
        gyro: Array,
        acceleration: Array,
        dt: float,
        torque: Array | None = None,
    ) -> RobotState:
        """Take a reading of the sensors and return the state of the robot.

        Args:
            joint_pos: joint angles ``[J]`` (rad).
            joint_vel: joint velocities ``[J]`` (rad/s).
            gyro: angular velocity ``[3]`` (rad/s, IMU).
            acceleration: specific force ``[3]`` (m/s², IMU): 9.81 upward at rest; best the mean since the last reading.
            dt: seconds since the last reading.
            torque: joint torques ``[J]`` (N m) as the motors report them; None where they do not.

        Raises:
            StateError: before :meth:`reset`, for readings of another size or that are not finite, and times that are
                not positive. Nothing has changed then.
        """
        self._check_begun("update")
        joint_pos, gyro, acceleration = self._checked(joint_pos, gyro, acceleration)
        joint_vel = self._numbers("joint_vel", joint_vel, len(joint_pos))
        torque = None if torque is None else self._numbers("torque", torque, len(joint_pos))
        self._check_dt(dt)
        kalman, settings = self._filter, self._settings
        mean_gyro = gyro if self._before is None else 0.5 * (gyro + self._before)
        self._before = gyro
        kalman.predict(mean_gyro, acceleration, dt)

        points_b, jacobian_b = self._soles(joint_pos)
        to_imu = self._imu_to_root.T
        rotation = kalman.rotation @ to_imu  # root to world
        offsets = (points_b - self._imu_pos) @ to_imu.T
        rate = kalman.rotation @ (gyro - kalman.gyro_bias)
        arms_w = offsets @ kalman.rotation.T
        velocity_w = kalman.velocity + np.cross(rate, arms_w) + (jacobian_b @ joint_vel) @ rotation.T
        touching = self._detector(arms_w, velocity_w, rotation @ jacobian_b, torque)

        moved = to_imu @ jacobian_b
        spread = settings.joint_pos**2 * moved @ np.swapaxes(moved, 1, 2) + settings.kinematics**2 * np.eye(3)
        kalman.touch(touching & ~self._standing, offsets, spread)
        stood = touching & self._standing
        refused = kalman.stand(stood, offsets, spread, settings.gate)
        if stood.any() and refused[stood].all():
            kalman.widen_velocity(settings.lost * dt**0.5)
        kalman.touch(refused, offsets, spread)  # it slipped: from here on it is another contact
        if settings.floor is not None:
            # the lowest point alone: a heel that is about to lift must not tilt the robot
            lowest = np.arange(len(touching)) == np.where(touching, kalman.contacts[:, 2], np.inf).argmin()
            kalman.level(lowest & touching, settings.floor, settings.floor_noise / dt**0.5)
        self._standing = touching
        return self._state(joint_pos, joint_vel, gyro)

    def hang(self, dt: float) -> RobotState:
        """Take it that the robot hangs, and on average does not move; return its state.

        Call it after :meth:`update` while somebody holds the robot. Without a foot on the floor nothing else keeps
        velocity and height from drifting.

        Args:
            dt: seconds that it stands for, those of the update.

        Raises:
            StateError: before :meth:`reset`, and for times that are not positive. Nothing has changed then.
        """
        self._check_begun("hang")
        self._check_dt(dt)
        self._filter.rest(self._settings.hanging / dt**0.5)
        return self._state(*self._reading)

    def measure(
        self,
        root_pos_w: Array | None = None,
        heading: float | None = None,
        *,
        spread: float = 0.02,
        heading_spread: float = 0.02,
    ) -> None:
        """Correct by a measurement from outside, such as motion capture or a marker that a camera sees.

        Args:
            root_pos_w: position of the root ``[3]`` (m, world).
            heading: of the root about the vertical (rad, world).
            spread: standard deviation of the position (m).
            heading_spread: of the heading (rad).

        Raises:
            StateError: before :meth:`reset`, for a position that has not three finite numbers, a heading that is not
                finite, and standard deviations that are not above 0. Nothing has changed then.
        """
        self._check_begun("measure")
        for name, value in (("spread", spread), ("heading_spread", heading_spread)):
            if not is_finite(value) or value <= 0:
                raise StateError(f"state estimator: {name} is {shown(value)}, expected a standard deviation above 0")
        if heading is not None and not is_finite(heading):
            raise StateError(f"state estimator: heading is {shown(heading)}, expected a finite angle")
        if root_pos_w is not None:
            place = self._numbers("root_pos_w", root_pos_w, 3)
            root_in_imu = -self._imu_to_root.T @ self._imu_pos
            self._filter.place(root_in_imu, place, spread**2 * np.eye(3))
        if heading is not None:
            root_x = self._imu_to_root[0]  # as the IMU sees it
            self._filter.turn_heading(heading, heading_spread, root_x)

    def anchor(self, pose: Pose) -> RobotState:
        """Move the world so that the robot stands, by position and heading, where a pose has its root.

        Returns the state of the robot in that world.

        Use it to lay the world of keyframes under a robot: ``estimator.anchor(sequence.start)``. Tilt, height and
        velocity in the robot's frame stay what they are.

        Args:
            pose: whose root position and orientation count.

        Raises:
            StateError: before :meth:`reset`, and for a pose that is not finite, or whose quaternion is not of unit
                length.
        """
        self._check_begun("anchor")
        place, quat = root_of("state estimator: pose", pose)
        target = quat_to_matrix(quat)
        here = self._filter.rotation @ self._imu_to_root.T
        turn = _about_z(_heading(target) - _heading(here))
        position = self._filter.position - here @ self._imu_pos
        shift = place - turn @ position
        shift[2] = 0.0  # the floor stays where it is
        self._filter.change_world(turn, shift)
        return self._state(*self._reading)

    def _check_begun(self, what: str) -> None:
        if not self._begun:
            raise StateError(
                f"state estimator: {what}() before reset(), which takes tilt and height from a robot that stands still"
            )

    def _check_dt(self, dt: float) -> None:
        if not (is_finite(dt) and 0 < dt < 1):
            raise StateError(f"state estimator: dt is {shown(dt)}, expected seconds above 0 and below 1")

    def _state(self, joint_pos: _Floats, joint_vel: _Floats, gyro: _Floats) -> RobotState:
        self._reading = (joint_pos, joint_vel, gyro)
        kalman = self._filter
        rotation = kalman.rotation @ self._imu_to_root.T
        rate = gyro - kalman.gyro_bias  # in the IMU's frame
        arm = self._imu_to_root.T @ self._imu_pos
        velocity = kalman.rotation.T @ kalman.velocity - np.cross(rate, arm)
        return RobotState(
            joint_pos=joint_pos,
            joint_vel=joint_vel,
            root_pos_w=kalman.position - rotation @ self._imu_pos,
            root_quat_w=quat_from_matrix(rotation),
            root_lin_vel_b=self._imu_to_root @ velocity,
            root_ang_vel_b=self._imu_to_root @ rate,
        )

    def _checked(self, joint_pos: Array, gyro: Array, acceleration: Array) -> tuple[_Floats, _Floats, _Floats]:
        joints = len(self._robot.joint_names)
        return (
            self._numbers("joint_pos", joint_pos, joints),
            self._numbers("gyro", gyro, 3),
            self._numbers("acceleration", acceleration, 3),
        )

    def _numbers(self, name: str, values: Array, size: int) -> _Floats:
        numbers = finite_vector(f"state estimator: {name}", values, size)
        if (wrong := np.flatnonzero(np.abs(numbers) > 1e6)).size:
            value = numbers[wrong[0]]
            raise StateError(f"state estimator: {name}[{wrong[0]}] is {value}, expected what a robot measures")
        return numbers


def _horizontal(root_pos_w: Array | tuple[float, float]) -> tuple[float, float]:
    """Return x and y (m) of a position of two or more numbers."""
    try:
        x_w, y_w, *_ = (float(value) for value in root_pos_w)
    except (OverflowError, TypeError, ValueError):
        x_w = y_w = np.nan
    if not np.isfinite((x_w, y_w)).all():
        raise StateError(f"state estimator: root_pos_w is {short(root_pos_w)}, expected x and y of the root (m)")
    return x_w, y_w


def _upright(up_b: _Floats, heading: float) -> _Floats:
    """Return the rotation ``[3, 3]`` that turns a direction of the root's frame upward, with a heading (rad)."""
    # the x axis of the root, made level, gives the heading; lying on it, the y axis does
    level = np.array([1.0, 0.0, 0.0]) - up_b[0] * up_b
    x = level / np.linalg.norm(level) if np.linalg.norm(level) > 0.1 else np.cross(up_b, (0.0, 0.0, 1.0))
    return _about_z(heading) @ np.stack((x, np.cross(up_b, x), up_b))


def _about_z(angle: float) -> _Floats:
    return axis_rotation(2, np.array([angle]))[0]


def _heading(rotation: _Floats) -> float:
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))
