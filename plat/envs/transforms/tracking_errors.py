"""Per-step errors of timed keyframe tracking."""

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Composite, Unbounded
from torchrl.envs import Transform

from plat.bounds import NonNegative, check_value
from plat.envs.transforms.base import Statistics, check_entries
from plat.envs.transforms.reward_terms import last_action
from plat.envs.transforms.terminations import TerminationLimits, commanded_parts, fallen
from plat.motions.library import MotionLibrary
from plat.rotations import quat_to_matrix

__all__ = ["METRIC_KEYS", "KeyframeMetrics", "TrackingError", "commanded_joints_and_bodies"]

METRIC_KEYS = (
    "joint_error",
    "keypoint_error",
    "keypoint_error_root",
    "action_change",
    "joint_jerk",
    "foot_slip",
    "fallen",
)
"""Entries of the metrics group."""


class TrackingError(Transform):
    """Transform that logs ``error/keypoint_aligned``: mean distance of the keypoints from the aligned reference (m).

    Needs :class:`ReferenceMotion` before it.
    """

    def __init__(self) -> None:
        super().__init__()
        self.statistics = Statistics()

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        offset = next_tensordict["state", "keypoint_pos_w"] - next_tensordict["reference", "keypoint_pos_aligned_w"]
        self.statistics.add("error/keypoint_aligned", torch.linalg.vector_norm(offset, dim=-1))
        return next_tensordict

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Check that the reference is there."""
        check_entries("TrackingError", [("reference", "keypoint_pos_aligned_w")], observation_spec)
        return observation_spec


class KeyframeMetrics(Transform):
    """Transform that adds errors against the time-aligned reference, and measures of smoothness.

    Writes the group ``"metrics"``, each entry ``[1]``: ``joint_error``: mean absolute error of the joint angles (rad);
    ``keypoint_error``: mean Euclidean error of the keypoints in the world (m); ``keypoint_error_root``: the same with
    both in the frame of their own root (m); ``action_change``: mean absolute change of the action since the previous
    step, from 0 in an episode's first; ``joint_jerk``: mean absolute jerk of the joints (rad/s^3, 0 in an episode's
    first two steps, which do not count in its mean); ``foot_slip``: mean horizontal speed (m/s) of the feet that bear
    load at the beginning of the last physics step, as MuJoCo says it after a step; ``fallen``: 1 where the root is at
    the wrong height or tilt. Needs :class:`ReferenceMotion` before it.

    Of a partial keyframe, means are over the commanded joints and bodies, and NaN where there are none. A root whose
    horizontal position and height are commanded counts as a body, but for ``keypoint_error_root`` only beside others:
    in its own frame it is never off.

    Args:
        library: motions; gives the robot and the control step.
        limits: what counts as fallen.
        loaded: ground reaction beyond which a foot bears load (N).
    """

    def __init__(self, library: MotionLibrary, limits: TerminationLimits | None = None, loaded: float = 5.0):
        super().__init__(out_keys=[("metrics", key) for key in METRIC_KEYS])
        check_value("metrics: loaded", loaded, NonNegative)
        self._dt = library.dt
        self._limits = limits or TerminationLimits()
        self._loaded = loaded
        self._robot = library.robot
        self._feet = [library.robot.keypoints.index(foot) for foot in library.robot.feet]
        self._past_joint_vel: list[Tensor] = []

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        state, reference = next_tensordict["state"], next_tensordict["reference"]
        pos, reference_pos = state["keypoint_pos_w"], reference["keypoint_pos_w"]
        body = _in_own_root(pos, state["keypoint_quat_w"])
        reference_body = _in_own_root(reference_pos, reference["keypoint_quat_w"])
        loaded = state["foot_force"] > self._loaded
        speed = torch.linalg.vector_norm(state["keypoint_lin_vel_w"][:, self._feet, :2], dim=-1)
        parts = commanded_parts(next_tensordict)
        joints = bodies = bodies_in_root = None
        if parts is not None:
            joints, bodies = commanded_joints_and_bodies(parts, state["joint_pos"].shape[-1])
            bodies_in_root = bodies * beside_root(bodies)[:, None]
        values = {
            "joint_error": _mean_of((state["joint_pos"] - reference["joint_pos"]).abs(), joints),
            "keypoint_error": _mean_of(torch.linalg.vector_norm(pos - reference_pos, dim=-1), bodies),
            "keypoint_error_root": _mean_of(torch.linalg.vector_norm(body - reference_body, dim=-1), bodies_in_root),
            "action_change": (tensordict["action"] - last_action(tensordict)).abs().mean(-1),
            "joint_jerk": self._jerk(state["joint_vel"]),
            "foot_slip": (speed * loaded).sum(-1) / loaded.sum(-1).clamp_min(1),
            "fallen": fallen(state, reference, self._robot, self._limits, parts).float(),
        }
        for key, value in values.items():
            next_tensordict["metrics", key] = value[:, None]
        return next_tensordict

    def _jerk(self, joint_vel: Tensor) -> Tensor:
        past = self._past_joint_vel
        self._past_joint_vel = [*past[-1:], joint_vel]
        if len(past) < 2:
            return torch.zeros_like(joint_vel[:, 0])
        jerk = (joint_vel - 2 * past[1] + past[0]).abs().mean(-1) / self._dt**2
        return jerk.nan_to_num(0.0)  # the velocities before a reset are NaN

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        mask = tensordict.get("_reset", None)
        if mask is None:
            self._past_joint_vel = []
        else:
            self._past_joint_vel = [vel.masked_fill(mask.view(-1, 1), torch.nan) for vel in self._past_joint_vel]
        frame = tensordict_reset["motion", "frame"]
        for key in self.out_keys:
            tensordict_reset[key] = torch.zeros(len(frame), 1, device=frame.device)
        return tensordict_reset

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Add the metrics."""
        check_entries("KeyframeMetrics", [("reference", "keypoint_pos_w")], observation_spec)
        count, device = observation_spec.shape, observation_spec.device
        entries = {key: Unbounded((*count, 1), device=device) for key in METRIC_KEYS}
        observation_spec["metrics"] = Composite(entries, shape=count, device=device)
        return observation_spec


def commanded_joints_and_bodies(parts: Tensor, num_joints: int) -> tuple[Tensor, Tensor]:
    """Return which joints ``[N, J]`` and bodies ``[N, K]`` errors are averaged over, of masks ``[N, J + K + 3]``.

    The root counts as its body where its horizontal position and its height are commanded.
    """
    bodies = parts[:, num_joints:-3].clone()
    bodies[:, 0] = torch.maximum(bodies[:, 0], parts[:, -3] * parts[:, -2])
    return parts[:, :num_joints], bodies


def beside_root(bodies: Tensor) -> Tensor:
    """Return whether another body than the root is commanded ``[N]``, of masks ``[N, K]``."""
    return (bodies[:, 1:] > 0).any(-1)


def _mean_of(errors: Tensor, commanded: Tensor | None) -> Tensor:
    """Return the mean of errors ``[N, n]`` over those that are commanded; NaN where there are none."""
    return errors.mean(-1) if commanded is None else (errors * commanded).sum(-1) / commanded.sum(-1)


def _in_own_root(keypoint_pos_w: Tensor, keypoint_quat_w: Tensor) -> Tensor:
    """Return keypoints ``[N, K, 3]`` relative to keypoint 0, in its frame."""
    return (keypoint_pos_w - keypoint_pos_w[:, :1]) @ quat_to_matrix(keypoint_quat_w[:, 0])
