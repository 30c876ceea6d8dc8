"""Right-invariant extended Kalman filter of a floating base with points of contact."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plat.bounds import Bounded, NonNegative, Positive
from plat.rotations_np import quat_from_rotvec, quat_to_matrix

__all__ = ["FilterNoise", "InvariantFilter"]

_Floats = NDArray[np.float64]
_GRAVITY = np.array([0.0, 0.0, -9.81])
_ROT, _VEL, _POS = slice(0, 3), slice(3, 6), slice(6, 9)


@dataclass(frozen=True)
class FilterNoise(Bounded):
    """Noise that the filter expects, as standard deviations."""

    gyro: Positive = 0.002
    """density of the gyroscope's noise (rad/s/√Hz)"""
    acceleration: Positive = 0.02
    """density of the accelerometer's noise (m/s²/√Hz)"""
    gyro_bias: NonNegative = 1e-4
    """random walk of the gyroscope's bias (rad/s/√s)"""
    acceleration_bias: NonNegative = 1e-3
    """random walk of the accelerometer's bias (m/s²/√s)"""
    slip: Positive = 0.03
    """random walk of a point in contact (m/√s)"""


class InvariantFilter:
    """Contact-aided invariant extended Kalman filter: orientation, velocity, position, contacts and biases of an IMU.

    The state is ``X`` in SE_(P+2)(3) with orientation ``R``, velocity ``v``, position ``p`` and contacts ``d_i``, all
    in the world, and the biases of gyroscope and accelerometer. The truth is ``exp(delta) X``: errors are in the world
    frame, so that the linearized measurement of a contact, ``R h(q) = d - p``, does not depend on the estimate.

    Source: Hartley, Ghaffari, Eustice, Grizzle, "Contact-aided invariant extended Kalman filtering for robot state
    estimation", IJRR 2020, https://arxiv.org/abs/1904.09251; before it, Bloesch et al., "State estimation for legged
    robots", RSS 2012 and IROS 2013, which estimates the same with other errors.

    Args:
        points: number of points that can touch the floor P.
        noise: that is expected.

    Attributes:
        rotation: ``R`` ``[3, 3]``, IMU to world.
        velocity: ``v`` ``[3]`` (m/s, world).
        position: ``p`` ``[3]`` (m, world).
        contacts: ``d`` ``[P, 3]`` (m, world), of the points that :meth:`touch` has set.
        gyro_bias: ``[3]`` (rad/s, IMU).
        acceleration_bias: ``[3]`` (m/s², IMU).
        covariance: of ``delta`` ``[9 + 3 P + 6]``.
    """

    def __init__(self, points: int, noise: FilterNoise = FilterNoise()):
        self._points = points
        self._noise = noise
        self._size = 9 + 3 * points + 6
        self._gyro_bias = slice(self._size - 6, self._size - 3)
        self._acceleration_bias = slice(self._size - 3, self._size)
        self.reset(np.eye(3), np.zeros(3))

    def reset(
        self, rotation: _Floats, position: _Floats, *, tilt: float = 0.01, speed: float = 0.05, bias: float = 0.003
    ) -> None:
        """Set orientation and position, at rest; position and heading are taken to be exact.

        Args:
            rotation: IMU to world ``[3, 3]``.
            position: of the IMU ``[3]`` (m, world).
            tilt: standard deviation of roll and pitch (rad).
            speed: of the velocity (m/s).
            bias: of the gyroscope's bias (rad/s); the accelerometer's is twenty times as large (m/s²).
        """
        self.rotation, self.position = np.array(rotation, float), np.array(position, float)
        self.velocity, self.gyro_bias, self.acceleration_bias = np.zeros(3), np.zeros(3), np.zeros(3)
        self.contacts = np.zeros((self._points, 3))
        spread = np.full(self._size, 1e-4)
        spread[:2] = tilt
        spread[_VEL], spread[self._gyro_bias], spread[self._acceleration_bias] = speed, bias, 20 * bias
        self.covariance = np.diag(spread**2)

    def predict(self, gyro: _Floats, acceleration: _Floats, dt: float) -> None:
        """Integrate one reading of the IMU.

        Args:
            gyro: angular velocity ``[3]`` (rad/s, IMU).
            acceleration: specific force ``[3]`` (m/s², IMU): 9.81 upward at rest.
            dt: seconds that it stands for.
        """
        rate, force = gyro - self.gyro_bias, acceleration - self.acceleration_bias
        # the mean orientation during the step carries the force to the world
        middle = self.rotation @ _exp(0.5 * dt * rate)
        pull = middle @ force + _GRAVITY
        move = self._adjoint()
        drift = np.zeros((self._size, self._size))
        drift[_VEL, _ROT] = _cross(_GRAVITY)
        drift[_POS, _VEL] = np.eye(3)
        drift[: self._gyro_bias.start, self._gyro_bias] = -move[:, :3]
        drift[: self._gyro_bias.start, self._acceleration_bias] = -move[:, 3:]
        step = np.eye(self._size) + dt * drift + 0.5 * dt**2 * (drift @ drift)
        levels = self._noise
        spread = np.repeat((levels.gyro, levels.acceleration), 3)
        moved = move * spread
        noise = np.zeros((self._size, self._size))
        noise[: len(move), : len(move)] = moved @ moved.T
        noise[range(9, len(move)), range(9, len(move))] += levels.slip**2
        noise[range(len(move), self._size), range(len(move), self._size)] += (
            np.repeat((levels.gyro_bias, levels.acceleration_bias), 3) ** 2
        )
        self.covariance = step @ (self.covariance + dt * noise) @ step.T
        self.position = self.position + dt * self.velocity + 0.5 * dt**2 * pull
        self.velocity = self.velocity + dt * pull
        self.rotation = self.rotation @ _exp(dt * rate)

    def touch(self, which: NDArray[np.bool_], points_b: _Floats, spread: _Floats) -> None:
        """Set points down: their contacts begin where kinematics puts them.

        Args:
            which: points ``[P]``.
            points_b: from the IMU to each point ``[P, 3]`` (m, IMU).
            spread: covariance of each ``[P, 3, 3]``.
        """
        for point in np.flatnonzero(which):
            self.contacts[point] = self.position + self.rotation @ points_b[point]
            rows = slice(9 + 3 * point, 12 + 3 * point)
            self.covariance[rows] = self.covariance[_POS]
            self.covariance[:, rows] = self.covariance[:, _POS]
            self.covariance[rows, rows] += self.rotation @ spread[point] @ self.rotation.T

    def stand(self, which: NDArray[np.bool_], points_b: _Floats, spread: _Floats, gate: float) -> NDArray[np.bool_]:
        """Correct by points that have not moved since they touched; return those that did not fit ``[P]``.

        Args:
            which: points in contact ``[P]``.
            points_b: from the IMU to each point ``[P, 3]`` (m, IMU).
            spread: covariance of each ``[P, 3, 3]``.
            gate: largest squared Mahalanobis distance that is believed.
        """
        refused = np.zeros(self._points, dtype=bool)
        chosen = np.flatnonzero(which)
        if not len(chosen):
            return refused
        innovation = points_b[chosen] @ self.rotation.T - (self.contacts[chosen] - self.position)
        noise = self.rotation @ spread[chosen] @ self.rotation.T
        # covariance of contact minus position, point by point
        blocks = self.covariance[_POS.start : self._gyro_bias.start, _POS.start : self._gyro_bias.start]
        blocks = np.swapaxes(blocks.reshape(self._points + 1, 3, self._points + 1, 3), 1, 2)
        after = chosen + 1
        expected = blocks[0, 0] + blocks[after, after] - blocks[0, after] - blocks[after, 0] + noise
        distance = np.einsum("pi,pi->p", innovation, np.linalg.solve(expected, innovation[..., None])[..., 0])
        fits = distance <= gate
        refused[chosen[~fits]] = True
        count, points = int(fits.sum()), chosen[fits]
        if count:
            rows = np.zeros((count, 3, self._size))
            rows[:, :, _POS] = -np.eye(3)
            rows[np.arange(count)[:, None], np.arange(3), 9 + 3 * points[:, None] + np.arange(3)] = 1.0
            joint = np.zeros((count, 3, count, 3))
            joint[np.arange(count), :, np.arange(count)] = noise[fits]
            size = 3 * count
            self.correct(rows.reshape(size, -1), innovation[fits].ravel(), joint.reshape(size, size))
        return refused

    def level(self, which: NDArray[np.bool_], height: float, spread: float) -> None:
        """Correct by the height of the floor under points in contact.

        Args:
            which: points ``[P]``.
            height: of the floor (m, world).
            spread: standard deviation (m).
        """
        chosen = np.flatnonzero(which)
        if not len(chosen):
            return
        rows = np.zeros((len(chosen), self._size))
        for row, point in zip(rows, chosen, strict=True):
            row[_ROT] = -_cross(self.contacts[point])[2]
            row[11 + 3 * point] = 1.0
        self.correct(rows, height - self.contacts[chosen, 2], spread**2 * np.eye(len(chosen)))

    def rest(self, spread: float) -> None:
        """Correct by a velocity of zero.

        Args:
            spread: standard deviation of each component (m/s).
        """
        rows = np.zeros((3, self._size))
        rows[:, _ROT] = -_cross(self.velocity)
        rows[:, _VEL] = np.eye(3)
        self.correct(rows, -self.velocity, spread**2 * np.eye(3))

    def place(self, point_b: _Floats, position: _Floats, spread: _Floats) -> None:
        """Correct by the measured place of a point that is fixed to the IMU.

        Args:
            point_b: the point ``[3]`` (m, IMU).
            position: its measured place ``[3]`` (m, world).
            spread: covariance ``[3, 3]``.
        """
        expected = self.position + self.rotation @ point_b
        self.correct(self._rows_of_place(expected), position - expected, spread)

    def turn(self, rotation: _Floats, spread: float) -> None:
        """Correct by a measured orientation.

        Args:
            rotation: IMU to world ``[3, 3]``.
            spread: standard deviation about each axis of the world (rad).
        """
        row = np.zeros((3, self._size))
        row[:, _ROT] = np.eye(3)
        self.correct(row, _log(rotation @ self.rotation.T), spread**2 * np.eye(3))

    def turn_heading(self, heading: float, spread: float, axis: _Floats | None = None) -> None:
        """Correct by a measured heading: the angle of an axis of the body about the vertical.

        Args:
            heading: (rad).
            spread: standard deviation (rad).
            axis: unit vector ``[3]`` (IMU); None for the IMU's x axis.
        """
        x, y, z = self.rotation[:, 0] if axis is None else self.rotation @ axis
        level = max(x * x + y * y, 1e-6)
        row = np.zeros((1, self._size))
        row[0, _ROT] = (-z * x / level, -z * y / level, 1.0)
        off = heading - np.arctan2(y, x)
        self.correct(row, np.array([np.arctan2(np.sin(off), np.cos(off))]), np.array([[spread**2]]))

    def change_world(self, rotation: _Floats, translation: _Floats) -> None:
        """Describe the same state in another world: ``x -> rotation x + translation``, gravity along -z in both."""
        adjoint = np.eye(self._size)
        shifted = _cross(translation) @ rotation
        for first in range(0, self._gyro_bias.start, 3):
            adjoint[first : first + 3, first : first + 3] = rotation
            if first >= _POS.start:
                adjoint[first : first + 3, _ROT] = shifted
        self.rotation, self.velocity = rotation @ self.rotation, rotation @ self.velocity
        self.position = rotation @ self.position + translation
        self.contacts = self.contacts @ rotation.T + translation
        self.covariance = adjoint @ self.covariance @ adjoint.T

    def widen_velocity(self, spread: float) -> None:
        """Doubt the velocity: add a standard deviation to each component (m/s)."""
        self.covariance[_VEL, _VEL] += spread**2 * np.eye(3)

    def correct(self, rows: _Floats, innovation: _Floats, noise: _Floats) -> None:
        """Correct by a linearized measurement ``innovation = rows @ delta + noise``.

        Args:
            rows: ``[M, 9 + 3 P + 6]``.
            innovation: measured minus expected ``[M]``.
            noise: covariance ``[M, M]``.
        """
        crossed = rows @ self.covariance
        gain = np.linalg.solve(crossed @ rows.T + noise, crossed).T
        delta = gain @ innovation
        # Joseph's form: symmetric and positive whatever the rounding
        keep = np.eye(self._size) - gain @ rows
        covariance = keep @ self.covariance @ keep.T + gain @ noise @ gain.T
        self.covariance = 0.5 * (covariance + covariance.T)
        turn, left = _exp(delta[_ROT]), _left_jacobian(delta[_ROT])
        self.rotation = _orthogonal(turn @ self.rotation)
        self.velocity = turn @ self.velocity + left @ delta[_VEL]
        self.position = turn @ self.position + left @ delta[_POS]
        self.contacts = self.contacts @ turn.T + delta[9 : self._gyro_bias.start].reshape(-1, 3) @ left.T
        self.gyro_bias = self.gyro_bias + delta[self._gyro_bias]
        self.acceleration_bias = self.acceleration_bias + delta[self._acceleration_bias]

    @property
    def position_spread(self) -> _Floats:
        """Return the standard deviation of the position ``[3]`` (m, world)."""
        rows = self._rows_of_place(self.position)
        return np.asarray(np.sqrt(np.diag(rows @ self.covariance @ rows.T)))

    def _rows_of_place(self, place: _Floats) -> _Floats:
        """Return how errors move a point of the body that is at a place ``[3]`` (m, world): rows ``[3, ...]``."""
        rows = np.zeros((3, self._size))
        rows[:, _ROT] = -_cross(place)
        rows[:, _POS] = np.eye(3)
        return rows

    def _adjoint(self) -> _Floats:
        """Return how errors of angular velocity and force enter ``delta`` ``[9 + 3 P, 6]``: columns of Ad_X."""
        columns = np.zeros((9 + 3 * self._points, 6))
        columns[_ROT, :3] = columns[_VEL, 3:] = self.rotation
        for first, vector in ((3, self.velocity), (6, self.position)):
            columns[first : first + 3, :3] = _cross(vector) @ self.rotation
        for point, contact in enumerate(self.contacts):
            columns[9 + 3 * point : 12 + 3 * point, :3] = _cross(contact) @ self.rotation
        return columns


def _cross(vector: _Floats) -> _Floats:
    """Return the matrix of the cross product by a vector."""
    x, y, z = vector
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


def _exp(rotvec: _Floats) -> _Floats:
    """Return the rotation matrix of a rotation vector (rad)."""
    return quat_to_matrix(quat_from_rotvec(rotvec))


def _log(rotation: _Floats) -> _Floats:
    """Return the rotation vector of a rotation matrix, less than half a turn (rad)."""
    axis = np.array((rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]))
    sine = 0.5 * float(np.linalg.norm(axis))
    angle = np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0))
    return 0.5 * axis * (angle / sine if sine > 1e-12 else 1.0)


def _left_jacobian(rotvec: _Floats) -> _Floats:
    """Return the left Jacobian of SO(3), with which translations enter the exponential of SE(3)."""
    angle = float(np.linalg.norm(rotvec))
    cross = _cross(rotvec)
    if angle < 1e-6:
        return np.eye(3) + 0.5 * cross
    return np.eye(3) + (1.0 - np.cos(angle)) / angle**2 * cross + (angle - np.sin(angle)) / angle**3 * (cross @ cross)


def _orthogonal(matrix: _Floats) -> _Floats:
    """Return the rotation next to a matrix that rounding has made almost one: a step of Newton's iteration."""
    return 1.5 * matrix - 0.5 * matrix @ matrix.T @ matrix
