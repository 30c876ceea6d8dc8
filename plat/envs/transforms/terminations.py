"""Termination conditions."""

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.data import Composite
from torchrl.envs import Transform

from plat.envs.transforms.base import Statistics, check_step_entries
from plat.envs.transforms.settings import TerminationLimits, TrackingLimits
from plat.robots.robot import Robot
from plat.rotations import quat_angle

__all__ = [
    "KeyframeTermination",
    "TerminationLimits",
    "TrackingLimits",
    "TrackingTermination",
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
            failed = failed | ((root - wanted).square().sum(-1, keepdim=True) > self.max_displacement**2)
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
        max_displacement: as for :class:`TrackingTermination`.
    """

    needs = (_REFERENCE, ("command", "in_window"))

    def __init__(self, robot: Robot, limits: TerminationLimits | None = None, *, max_displacement: float | None = None):
        super().__init__(robot, max_displacement)
        self.limits = limits or TerminationLimits()

    def failed(self, next_tensordict: TensorDictBase) -> Tensor:
        """Return the mask ``[N]`` of the robots whose command has failed."""
        state, reference = next_tensordict["state"], next_tensordict["reference"]
        in_window = next_tensordict["command", "in_window"][:, 0]
        return torch.where(
            in_window,
            off_pose(state, reference, self.robot, self.limits),
            fallen(state, reference, self.limits),
        )


def _height_error(state: TensorDictBase, reference: TensorDictBase, keypoints: list[int]) -> Tensor:
    """Return the largest height error ``[N]`` (m) among some keypoints."""
    return (state["keypoint_pos_w"][:, keypoints, 2] - reference["keypoint_pos_w"][:, keypoints, 2]).abs().amax(-1)


def _tilt_error(state: TensorDictBase, reference: TensorDictBase, keypoint: int) -> Tensor:
    """Return the difference ``[N]`` of the vertical component of gravity in a body's frame."""
    # that component is 1 - 2 (x^2 + y^2)
    lean = [group["keypoint_quat_w"][:, keypoint, 1:3].square().sum(-1) for group in (state, reference)]
    return 2 * (lean[0] - lean[1]).abs()


def off_track(state: TensorDictBase, reference: TensorDictBase, robot: Robot, limits: TrackingLimits) -> Tensor:
    """Return the mask ``[N]`` of robots with an anchor at a wrong height or tilt, or an ankle or wrist at a wrong
    height.
    """
    return (
        (_height_error(state, reference, [robot.anchor_index]) > limits.anchor_height)
        | (_tilt_error(state, reference, robot.anchor_index) > limits.anchor_tilt)
        | (_height_error(state, reference, robot.end_effector_indices) > limits.end_effector_height)
    )


def off_pose(state: TensorDictBase, reference: TensorDictBase, robot: Robot, limits: TerminationLimits) -> Tensor:
    """Return the mask ``[N]`` of robots beyond the arrival window's thresholds against the time-aligned reference."""
    anchor = robot.anchor_index
    turn = quat_angle(state["keypoint_quat_w"][:, anchor], reference["keypoint_quat_w"][:, anchor])
    return (
        (_height_error(state, reference, [anchor]) > limits.anchor_height)
        | (turn.square() > limits.anchor_rot_squared)
        | (_height_error(state, reference, robot.end_effector_indices) > limits.end_effector_height)
    )


def fallen(state: TensorDictBase, reference: TensorDictBase, limits: TerminationLimits) -> Tensor:
    """Return the mask ``[N]`` of robots whose root height or tilt is far from the reference's."""
    return (_height_error(state, reference, [0]) > limits.root_height) | (
        _tilt_error(state, reference, 0) > limits.root_tilt
    )
