"""Motors of an MJCF description: limits of targets and torques in the one form that plat computes with."""

import math

import mujoco
import numpy as np

from plat.errors import RobotError
from plat.words import counted

__all__ = ["adopt_limits", "check_actuators"]

# A range of targets may end this far (rad) inside that of its joint: it was rounded.
_ROUNDED = 0.01
_ON, _AUTO = int(mujoco.mjtLimited.mjLIMITED_TRUE), int(mujoco.mjtLimited.mjLIMITED_AUTO)


def adopt_limits(spec: mujoco.MjSpec, where: str) -> tuple[str, ...]:
    """Bring limits of a description to the form that plat computes with, and return what it reads otherwise.

    The torque of a motor is limited by its ``forcerange`` alone: an ``actuatorfrcrange`` of the joint becomes that, or
    narrows it. Targets have no limits: a policy may ask for one beyond the stop, which is how it pushes against it,
    and a robot is sent it as it is. A ``ctrlrange`` that begins at the joint's limits is therefore left out.

    Args:
        spec: description that is changed.
        where: robot and file; begins messages.

    Returns:
        A line for what was left out; nothing where the description means what it says.

    Raises:
        RobotError: naming the joint of the actuator whose limits plat would read wrongly, and what would be right.
    """
    joints = {joint.name: joint for joint in spec.joints}
    left_out = 0
    for actuator in spec.actuators:
        joint = joints.get(actuator.target)
        if joint is None or actuator.trntype != mujoco.mjtTrn.mjTRN_JOINT:
            continue  # refused when the model is checked
        told = f"{where}: the actuator of joint {joint.name!r}"
        limits = [
            _torque(actuator.forcelimited, actuator.forcerange, f"{told} has forcerange"),
            _torque(joint.actfrclimited, joint.actfrcrange, f"{where}: joint {joint.name!r} has actuatorfrcrange"),
        ]
        if given := [limit for limit in limits if limit is not None]:
            actuator.forcerange, actuator.forcelimited = [-min(given), min(given)], _ON
            joint.actfrcrange, joint.actfrclimited = [0, 0], int(mujoco.mjtLimited.mjLIMITED_FALSE)
        low, high = _joint_range(joint, spec)
        targets = _targets(actuator, low, high)
        if targets is not None:
            if targets[0] > low + _ROUNDED or targets[1] < high - _ROUNDED:
                raise RobotError(
                    f"{told} has ctrlrange {targets[0]:g} {targets[1]:g} inside the joint's range {low:g} {high:g}, "
                    "expected none: plat does not clip targets; narrow the joint's range instead"
                )
            left_out += 1
        actuator.ctrlrange, actuator.ctrllimited = [0, 0], int(mujoco.mjtLimited.mjLIMITED_FALSE)
        actuator.inheritrange = 0
    if not left_out:
        return ()
    return (
        f"{where}: the ctrlrange of {counted(left_out, 'actuator')} is left out: a policy's targets may lie beyond the "
        "joints' limits, in simulation and on a robot",
    )


def check_actuators(model: mujoco.MjModel, where: str) -> None:
    """Check what gains, torque limits and the size of actions are read from.

    Args:
        model: of a description with :func:`adopt_limits`; it has one actuator a hinge.
        where: robot and file; begins messages.

    Raises:
        RobotError: naming the joint of an actuator that is no position actuator, and what would be right.
    """
    for index in range(len(model.actuator_trnid)):
        actuator = f"{where}: the actuator of joint {model.joint(index + 1).name!r}"
        gain, bias = model.actuator_gainprm[index], model.actuator_biasprm[index]
        kinds = (
            model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT,
            model.actuator_gaintype[index] == mujoco.mjtGain.mjGAIN_FIXED,
            model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_AFFINE,
        )
        if not all(kinds) or gain[0] <= 0 or bias[0] != 0 or bias[1] != -gain[0] or model.actuator_gear[index, 0] != 1:
            raise RobotError(f"{actuator} is no position actuator of gear 1, expected <position> with kp and kv")
        if model.actuator_dyntype[index] != mujoco.mjtDyn.mjDYN_NONE:
            raise RobotError(
                f"{actuator} has activation dynamics, expected none: plat's motors have no state of their own; leave "
                "out its timeconst or dyntype"
            )
        if model.actuator_delay[index] > 0:
            raise RobotError(
                f"{actuator} has a delay of {model.actuator_delay[index]:g} s, expected none: nothing resets the "
                "targets that wait"
            )
        if not model.actuator_forcelimited[index] or model.actuator_forcerange[index, 1] <= 0:
            raise RobotError(f"{actuator} has no torque limits, expected its forcerange")


def _is_limited(flag: int, span: np.ndarray) -> bool:
    """Return whether a range counts: MuJoCo takes one that is given, unless it is told."""
    return flag == _ON or (flag == _AUTO and bool(np.any(span)))


def _torque(flag: int, span: np.ndarray, told: str) -> float | None:
    """Return the largest torque of a range (N m); None where there is none."""
    if not _is_limited(flag, span):
        return None
    low, high = (float(end) for end in span)
    if high <= 0 or not math.isclose(-low, high, rel_tol=1e-6):
        largest = max(abs(low), abs(high))
        raise RobotError(
            f"{told} {low:g} {high:g}, expected one torque for both directions, such as -{largest:g} {largest:g}"
        )
    return high


def _joint_range(joint: mujoco.MjsJoint, spec: mujoco.MjSpec) -> tuple[float, float]:
    """Return the limits of a joint (rad), which a description may state in degrees."""
    unit = math.pi / 180 if spec.compiler.degree else 1.0
    return float(joint.range[0]) * unit, float(joint.range[1]) * unit


def _targets(actuator: mujoco.MjsActuator, low: float, high: float) -> tuple[float, float] | None:
    """Return the lowest and highest target of an actuator of a joint (rad); None where it has no limits."""
    if actuator.inheritrange > 0:
        middle, half = (low + high) / 2, (high - low) / 2
        return middle - actuator.inheritrange * half, middle + actuator.inheritrange * half
    if not _is_limited(actuator.ctrllimited, actuator.ctrlrange):
        return None
    return float(actuator.ctrlrange[0]), float(actuator.ctrlrange[1])
