"""Policy runner: the control step of an exported policy."""

import hashlib
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plat.bounds import is_finite, shown
from plat.deploy.bundle import HASH_FIELD, INPUT, METADATA_KEY, OUTPUT, Bundle
from plat.deploy.joint_names import check_joints
from plat.deploy.onnx_session import open_session
from plat.deploy.state import Array, Pose, RobotState, finite_vector
from plat.errors import ActionError, BundleError, StateError
from plat.files import as_path
from plat.json_file import parse_json, read_json
from plat.spec.timing import Timing

__all__ = ["BUNDLE_FILE", "NETWORK_FILE", "JointCommand", "PolicyRunner"]

BUNDLE_FILE, NETWORK_FILE = "bundle.json", "policy.onnx"
# tolerance for rounded times, in control steps
_TIME_TOLERANCE = 1e-3
_DT_TOLERANCE = 1e-9  # seconds


class JointCommand(NamedTuple):
    """Motor command of a PD controller: ``torque = stiffness * (position - joint_pos) - damping * joint_vel``."""

    position: NDArray[np.float64]
    """joint position targets ``[J]`` (rad)"""
    stiffness: NDArray[np.float64]
    """kp ``[J]`` (N m/rad)"""
    damping: NDArray[np.float64]
    """kd ``[J]`` (N m s/rad)"""


class PolicyRunner:
    """Runs the policy of a bundle on one robot. Call :meth:`reset` before the first step of every episode.

    ``docs/deploy.md`` shows the control loop on a robot.

    Args:
        bundle: folder that ``plat export`` wrote, or the ``.onnx`` file alone.
        joint_names: the joints in the order of the caller's joint vectors, or a table of motors, such as
            ``{"LeftHipPitch": 0}``; refused unless they are the policy's. ``_joint`` and capitals do not matter.
        control_dt: seconds of the caller's control step; refused unless it is the policy's.

    Raises:
        BundleError: when a file is missing, broken, without metadata, of another version, of another robot or of
            another control step; when the network is not the one that the bundle was written with; when onnxruntime
            is not installed.

    Warns:
        UserWarning: for a bundle of an older version, which does not hold its network's hash.
    """

    def __init__(
        self,
        bundle: str | Path,
        joint_names: Sequence[str] | Mapping[str, int] | None = None,
        control_dt: float | None = None,
    ):
        path = as_path(bundle, "bundle", BundleError)
        network = _network(path)
        self._session = open_session(network)
        self.bundle = _metadata(self._session, network)
        """What the policy says about itself."""
        robot = self.robot = self.bundle.robot
        """The robot that it drives."""
        if joint_names is not None:
            check_joints(f"bundle {str(path)!r}", robot.joint_names, joint_names)
        given = robot.control_dt if control_dt is None else control_dt
        if not (is_finite(given) and abs(given - robot.control_dt) <= _DT_TOLERANCE):
            told = f"control step of {robot.control_dt:g} s, not the {shown(given)} s of this robot"
            raise BundleError(f"bundle {str(path)!r}: {told}")
        self._observe = self.bundle.observation_builder()
        self._where = f"ONNX policy {str(network)!r}"
        _check_widths(self._where, self._session, self._observe.size, len(robot.joint_names))
        self._run(np.zeros(self._observe.size, np.float32))
        self.reset()

    @property
    def timing(self) -> Timing:
        """Return the policy's control step, longest command and arrival window."""
        return self.bundle.timing

    @property
    def sees_parts(self) -> bool:
        """Return whether the policy sees which parts of a pose a keyframe commands."""
        return "parts" in self.bundle.also

    def reset(self, joint_target: Array | None = None) -> None:
        """Start a new episode.

        Args:
            joint_target: last joint position target sent to the motors ``[J]`` (rad); None for the default pose.

        Raises:
            StateError: for a target of another size, or that is not finite.
        """
        robot = self.robot
        target = robot.default_joint_pos if joint_target is None else joint_target
        target = finite_vector("joint_target", target, len(robot.joint_names))
        self._last_action = (target - robot.default_joint_pos) / robot.action_scale

    def __call__(self, state: RobotState, keyframe: Pose, steps_left: float) -> NDArray[np.float64]:
        """Compute the joint position targets ``[J]`` (rad); call it once a control step.

        Args:
            state: of the robot now.
            keyframe: commanded pose.
            steps_left: control steps until its arrival, more than 0 and at most ``bundle.max_steps``.

        Raises:
            StateError: naming what is wrong with state, keyframe or time.
            ActionError: for a target that is not finite, naming the joint.

        After either error the motors should hold their last target. The runner remembers that one too: the next call
        goes on as if the refused step had not been.
        """
        known = is_finite(steps_left)
        if not (known and 0 < steps_left <= self.bundle.max_steps + _TIME_TOLERANCE):
            longest, dt = self.bundle.max_steps, self.robot.control_dt
            left = f"{steps_left:g} control steps ({steps_left * dt:g} s)" if known else shown(steps_left)
            raise StateError(
                f"time to the keyframe is {left}, expected more than 0 and at most {longest} ({longest * dt:g} s)"
            )
        steps_left = float(steps_left)  # it may be an array without axes
        whole = round(steps_left)  # a clock that counted down to 0.06 s has 3.00000000003 steps left
        steps_left = whole if whole and abs(steps_left - whole) < _TIME_TOLERANCE else steps_left
        observation = self._observe(state, keyframe, steps_left, self._last_action)
        target = self._run(observation)
        if not np.isfinite(target).all():
            joint = int(np.flatnonzero(~np.isfinite(target))[0])
            raise ActionError(
                f"{self._where}: the target of joint {self.robot.joint_names[joint]!r} is {target[joint]}, expected a "
                "finite angle; hold the last targets"
            )
        self._last_action = (target - self.robot.default_joint_pos) / self.robot.action_scale
        return target

    def step(self, state: RobotState, keyframe: Pose, time_left: float) -> JointCommand:
        """Compute the motor command for a time in seconds: joint targets with the gains that they were trained with."""
        steps_left = time_left / self.robot.control_dt if is_finite(time_left) else time_left
        target = self(state, keyframe, steps_left)
        # copies: a program that softens the gains that it is given must not soften those of the next step
        return JointCommand(target, self.robot.stiffness.copy(), self.robot.damping.copy())

    def _run(self, observation: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the network's output ``[J]``."""
        try:
            output = self._session.run([OUTPUT], {INPUT: observation[None]})[0]
        except Exception as error:  # onnxruntime has a class of its own for every kind of failure
            line = str(error).strip().splitlines()[0]
            raise BundleError(f"{self._where}: the network does not run ({line})") from error
        expected = (1, len(self.robot.joint_names))
        if output.shape != expected:
            raise BundleError(f"{self._where}: the network's output has shape {output.shape}, expected {expected}")
        return output[0].astype(np.float64)


def _network(path: Path) -> Path:
    """Return the network of a bundle, which may be given alone."""
    if path.suffix == ".onnx":
        return path
    network = path / NETWORK_FILE
    if os.path.isfile(network):  # false for a name that is too long, too
        return network
    there = f"holds no {NETWORK_FILE}" if os.path.isdir(path) else "no such folder"
    told = "is a file" if os.path.isfile(path) else there
    raise BundleError(f"bundle {str(path)!r}: {told}, expected a folder; plat export RUN --out FOLDER writes one")


def _metadata(session: Any, network: Path) -> Bundle:
    """Return the metadata from inside the network's file and from beside it. One is enough; two must agree."""
    try:
        inside = session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
    except UnicodeDecodeError:
        raise BundleError(f"ONNX policy {str(network)!r}: its metadata are no UTF-8") from None
    path = network.with_name(BUNDLE_FILE)
    if not path.exists():
        if inside is None:
            raise BundleError(
                f"ONNX policy {str(network)!r}: no metadata in it and no {BUNDLE_FILE} beside it, "
                "expected a file that plat export wrote"
            )
        return Bundle.from_json(inside, f"metadata in {str(network)!r}")
    beside = read_json(path, BundleError, repr(str(path)), constants=True)
    bundle = Bundle.from_content(beside, repr(str(path)))
    if inside is not None:
        where = f"metadata in {str(network)!r}"
        within = parse_json(inside.encode(errors="surrogatepass"), BundleError, where, constants=True)
        # a file cannot hold its own hash
        if within != {name: value for name, value in beside.items() if name != HASH_FIELD}:
            raise BundleError(
                f"{str(path)!r} differs from the metadata in {str(network)!r}: are these files of two exports?"
            )
    _check_hash(bundle, path, network)
    return bundle


def _check_hash(bundle: Bundle, path: Path, network: Path) -> None:
    if bundle.network_sha256 is None:
        warnings.warn(
            f"{str(path)!r} does not hold its network's hash: export it again, and a changed network is refused",
            stacklevel=4,
        )
        return
    found = hashlib.sha256(network.read_bytes()).hexdigest()
    if found != bundle.network_sha256:
        raise BundleError(
            f"{str(network)!r} has the SHA-256 {found[:12]}..., {BUNDLE_FILE} was written with "
            f"{bundle.network_sha256[:12]}...: the network was changed after its export"
        )


def _check_widths(where: str, session: Any, features: int, joints: int) -> None:
    found = [(entry.name, *entry.shape[-1:]) for entry in (*session.get_inputs(), *session.get_outputs())]
    expected = [(INPUT, features), (OUTPUT, joints)]
    if found != expected:
        raise BundleError(f"{where}: input and output {found}, expected {expected}")
