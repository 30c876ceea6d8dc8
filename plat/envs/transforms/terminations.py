"""Termination conditions."""

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.data import Composite
from torchrl.envs import Transform

from plat.bounds import Positive, check_robot, check_value
from plat.envs.transforms.base import Statistics, check_step_entries
from plat.envs.transforms.settings import TerminationLimits, TrackingLimits
from plat.robots.robot import Robot
from plat.rotations import quat_angle
from plat.spec.proportions import in_proportion

__all__ = [
    "KeyframeTermination",
    "TerminationLimits",
    "TrackingLimits",
    "TrackingTermination",
    "commanded_parts",
    "fallen",
    "off_pose",
    "off_track",
]

_REFERENCE = ("reference", "keypoint_pos_w")


class _Termination(Transform):
    """Base of terminations: :meth:`failed` holds, or the root is too far from its reference."""

    needs: tuple[NestedKey, ...] = (_REFERENCE,)

    def __init__(self, robot: Robot, max_displacement: float | None):
        super().__init__()
        check_robot(robot)
        check_value("termination: max_displacement", max_displacement, Positive | None)
        self.statistics = Statistics()
        self.robot = robot
        self.max_displacement = max_displacement

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Check that the transforms that it needs stand before it."""
        check_step_entries(type(self).__name__, self.needs, observation_spec)
        return observation_spec

    def failed(self, next_tensordict: TensorDictBase) -> Tensor:
        """Return the mask ``[N]`` of the robots that have failed."""
        raise NotImplementedError

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        failed = self.failed(next_tensordict)[:, None]
        if self.max_displacement is not None:
            root, wanted = (next_tensordict[group, "keypoint_pos_w"][:, 0, :2] for group in ("state", "reference"))
            displaced = (root - wanted).square().sum(-1, keepdim=True) > self.max_displacement**2
            parts = commanded_parts(next_tensordict)
            if parts is not None:
                # until it arrives a robot may be where a command before left it, which left the place open
                displaced = displaced & (parts[:, -3:-2] > 0) & next_tensordict["command", "in_window"]
            failed = failed | displaced
        self.statistics.add("terminated", failed.float())
        next_tensordict["terminated"] = next_tensordict["terminated"] | failed
        next_tensordict["done"] = next_tensordict["terminated"] | next_tensordict["truncated"]
        return next_tensordict


class TrackingTermination(_Termination):
    """Termination of dense tracking when the robot is :func:`off_track`. Needs :class:`ReferenceMotion` before it.

    Args:
        robot: names the bodies.
        limits: when tracking has failed.
        max_displacement: horizontal error of the root (m) that also terminates; None for no such limit. It is
            for training: a robot that lags behind by a meter gets no reward for catching up.
    """

    def __init__(self, robot: Robot, limits: TrackingLimits | None = None, *, max_displacement: float | None = None):
        super().__init__(robot, max_displacement)
        self.limits = limits or TrackingLimits()

    def failed(self, next_tensordict: TensorDictBase) -> Tensor:
        """Return the mask ``[N]`` of the robots that are off track."""
        return off_track(next_tensordict["state"], next_tensordict["reference"], self.robot, self.limits)


class KeyframeTermination(_Termination):
    """Termination of a failed command: :func:`off_pose` in the arrival window, or :func:`fallen` before it.

    Between keyframes the reference is not the goal, so there only a fall counts. Needs :class:`ReferenceMotion` and
    :class:`KeyframeClock` before it. Source: the evaluation of the paper.

    Args:
        robot: names the bodies.
        limits: when a command has failed.
        max_displacement: as for :class:`TrackingTermination`; of partial keyframes in the arrival window alone.
    """

    needs = (_REFERENCE, ("command", "in_window"))

    def __init__(self, robot: Robot, limits: TerminationLimits | None = None, *, max_displacement: float | None = None):
        super().__init__(robot, max_displacement)
        self.limits = limits or TerminationLimits()

    def failed(self, next_tensordict: TensorDictBase) -> Tensor:
        """Return the mask ``[N]`` of the robots whose command has failed."""
        state, reference = next_tensordict["state"], next_tensordict["reference"]
        in_window, parts = next_tensordict["command", "in_window"][:, 0], commanded_parts(next_tensordict)
        return torch.where(
            in_window,
            off_pose(state, reference, self.robot, self.limits, parts),
            fallen(state, reference, self.robot, self.limits, parts),
        )


def commanded_parts(next_tensordict: TensorDictBase) -> Tensor | None:
    """Return the masks ``[N, J + K + 3]`` of the commands that a step belonged to; None for whole keyframes."""
    return next_tensordict.get(("command", "parts"), None)


def _height_error(state: TensorDictBase, reference: TensorDictBase, keypoints: list[int]) -> Tensor:
    """Return the largest height error ``[N]`` (m) among some keypoints."""
    return (state["keypoint_pos_w"][:, keypoints, 2] - reference["keypoint_pos_w"][:, keypoints, 2]).abs().amax(-1)


def _tilt_error(state: TensorDictBase, reference: TensorDictBase, keypoint: int) -> Tensor:
    """Return the difference ``[N]`` of the vertical component of gravity in a body's frame."""
    # that component is 1 - 2 (x^2 + y^2)
    return 2 * (_lean(state, keypoint) - _lean(reference, keypoint)).abs()


def _lean(group: TensorDictBase, keypoint: int) -> Tensor:
    """Return ``x^2 + y^2`` of a body's quaternion ``[N]``: 0 when it is upright, 1 upside down."""
    return group["keypoint_quat_w"][:, keypoint, 1:3].square().sum(-1)


def off_track(state: TensorDictBase, reference: TensorDictBase, robot: Robot, limits: TrackingLimits) -> Tensor:
    """Return the mask ``[N]`` of robots with an anchor at a wrong height or tilt, or an ankle or wrist at a wrong
    height.
    """
    return (
        (_height_error(state, reference, [robot.anchor_index]) > limits.anchor_height)
        | (_tilt_error(state, reference, robot.anchor_index) > limits.anchor_tilt)
        | (_height_error(state, reference, robot.end_effector_indices) > limits.end_effector_height)
    )


def off_pose(
    state: TensorDictBase,
    reference: TensorDictBase,
    robot: Robot,
    limits: TerminationLimits,
    parts: Tensor | None = None,
) -> Tensor:
    """Return the mask ``[N]`` of robots beyond the arrival window's thresholds against the time-aligned reference.

    For a partial keyframe, the root's height and orientation count in place of the anchor's, and the heights of bodies,
    each only if commanded. A robot that has :func:`fallen` is off any pose.

    Args:
        state, reference: keypoints of robot and reference.
        robot: names the bodies.
        limits: thresholds.
        parts: masks ``[N, J + K + 3]`` of what is commanded; None for whole keyframes.
    """
    anchor = robot.anchor_index
    turn = quat_angle(state["keypoint_quat_w"][:, anchor], reference["keypoint_quat_w"][:, anchor])
    whole = (
        (_height_error(state, reference, [anchor]) > limits.anchor_height)
        | (turn.square() > limits.anchor_rot_squared)
        | (_height_error(state, reference, robot.end_effector_indices) > limits.end_effector_height)
    )
    if parts is None:
        return whole
    commanded = parts > 0
    heights = (state["keypoint_pos_w"][..., 2] - reference["keypoint_pos_w"][..., 2]).abs()
    turn = quat_angle(state["keypoint_quat_w"][:, 0], reference["keypoint_quat_w"][:, 0])
    off = (
        (commanded[:, -2] & (heights[:, 0] > limits.anchor_height))
        | (commanded[:, -1] & (turn.square() > limits.anchor_rot_squared))
        | (commanded[:, robot.num_joints : -3] & (heights > limits.end_effector_height)).any(-1)
        | fallen(state, reference, robot, limits, parts)
    )
    return torch.where(commanded.all(-1), whole, off)


# m, of a robot whose root stands at 0.76 m: a root below this, where its height is not commanded, has fallen if the
# reference has not
_LOW = 0.4


def fallen(
    state: TensorDictBase,
    reference: TensorDictBase,
    robot: Robot,
    limits: TerminationLimits,
    parts: Tensor | None = None,
) -> Tensor:
    """Return the mask ``[N]`` of robots whose root height or tilt is far from the reference's.

    Where height or orientation is not commanded, it has to be that of a fall as well: low, or more tilted. Low is below
    0.4 m of a robot whose root stands at 0.76 m, and of others in proportion.

    Args:
        state, reference, limits, parts: as of :func:`off_pose`.
        robot: gives the height at which it stands.
    """
    low = _height_error(state, reference, [0]) > limits.root_height
    tilted = _tilt_error(state, reference, 0) > limits.root_tilt
    if parts is not None:
        height, wanted = state["keypoint_pos_w"][:, 0, 2], reference["keypoint_pos_w"][:, 0, 2]
        low &= (parts[:, -2] > 0) | ((height < in_proportion(_LOW, robot.root_height)) & (height < wanted))
        more = _lean(state, 0) > _lean(reference, 0)
        tilted &= (parts[:, -1] > 0) | more
    return low | tilted
