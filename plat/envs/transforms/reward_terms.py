"""Terms of the tracking rewards and penalties: squared errors, and the kernel over them."""

from collections.abc import Callable

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor

from plat.envs.transforms.rewards import Reward, RewardFunction
from plat.envs.transforms.settings import TrackingTerm
from plat.envs.transforms.terminations import commanded_parts
from plat.rotations import quat_angle
from plat.spec.observation import table

__all__ = [
    "Reward",
    "anchor_pos_error",
    "anchor_rot_error",
    "arriving",
    "commanded_anchor_pos_error",
    "commanded_ang_vel_error",
    "commanded_difference",
    "commanded_joint_pos_error",
    "commanded_rot_error",
    "difference",
    "foot_slip",
    "joint_pos_error",
    "keypoint_rot_error",
    "last_action",
    "limit_excess",
    "squared_distance",
    "tracking",
]

_IN_WINDOW = ("command", "in_window")

# A squared error [N] of the state and the reference after a step.
_SquaredError = Callable[[TensorDictBase, TensorDictBase], Tensor]


# The same over what is commanded, for masks [N, J + K + 3]: the squared error [N], and whether anything of it is.
_PartialError = Callable[[TensorDictBase, TensorDictBase, Tensor], tuple[Tensor, Tensor]]


def tracking(name: str, term: TrackingTerm, squared_error: _SquaredError, partial_error: _PartialError) -> Reward:
    """Return a term that is paid at every step, on the way to a partial keyframe for the commanded part alone.

    Args:
        name: of the term.
        term: weight and scale.
        squared_error: of the whole pose.
        partial_error: of a part of it; where nothing of it is commanded, nothing is paid.
    """
    return Reward(name, term.weight, _paid(term, squared_error, partial_error), needs=(("reference", "joint_pos"),))


def arriving(name: str, term: TrackingTerm, squared_error: _SquaredError, partial_error: _PartialError) -> Reward:
    """Return a term like those of :func:`tracking` that is paid in the arrival window; its name is longer."""
    paid = _paid(term, squared_error, partial_error)
    needs: tuple[NestedKey, ...] = (("reference", "joint_pos"), _IN_WINDOW)
    return Reward(f"keyframe_{name}", term.weight, lambda *step: paid(*step) * step[1][_IN_WINDOW][:, 0], needs)


def _paid(term: TrackingTerm, squared_error: _SquaredError, partial_error: _PartialError) -> RewardFunction:
    def paid(before: TensorDictBase, after: TensorDictBase) -> Tensor:
        state, reference, parts = after["state"], after["reference"], commanded_parts(after)
        error = squared_error(state, reference)
        if parts is None:
            return _kernel(error, term)
        of_part, commanded = partial_error(state, reference, parts)
        whole = (parts > 0).all(-1)
        return _kernel(torch.where(whole, error, of_part), term) * (whole | commanded)

    return paid


def _kernel(squared_error: Tensor, term: TrackingTerm) -> Tensor:
    return torch.exp(squared_error / -(term.scale**2))


def difference(entry: str, reference_entry: str | None = None) -> _SquaredError:
    """Return the squared distance of an entry ``[N, K, 3]`` of the state from that of the reference."""
    return lambda state, reference: squared_distance(state[entry], reference[reference_entry or entry])


def squared_distance(actual: Tensor, wanted: Tensor) -> Tensor:
    """Return the mean over keypoints of the squared distance: ``[N, K, 3]`` to ``[N]``."""
    # one sum over both dimensions: reducing a last dimension of 3 alone is several times slower
    return (actual - wanted).square().flatten(1).sum(-1) / actual.shape[1]


def joint_pos_error(state: TensorDictBase, reference: TensorDictBase) -> Tensor:
    """Return the mean over joints of the squared error ``[N]`` (rad^2)."""
    return (state["joint_pos"] - reference["joint_pos"]).square().mean(-1)


def commanded_joint_pos_error(state: TensorDictBase, reference: TensorDictBase, parts: Tensor) -> tuple[Tensor, Tensor]:
    """Return the mean squared error ``[N]`` (rad^2) of the commanded joints, and whether there are some."""
    errors = (state["joint_pos"] - reference["joint_pos"]).square()
    commanded = parts[:, : errors.shape[-1]]
    count = commanded.sum(-1)
    return (errors * commanded).sum(-1) / count.clamp_min(1.0), count > 0


def commanded_difference(entry: str, reference_entry: str | None = None) -> _PartialError:
    """Return the mean squared distance of an entry ``[N, K, 3]`` over the commanded bodies, and whether there are some.

    The root is one of them where its position is commanded, along the axes that are.
    """

    def error(state: TensorDictBase, reference: TensorDictBase, parts: Tensor) -> tuple[Tensor, Tensor]:
        errors = (state[entry] - reference[reference_entry or entry]).square()
        commanded = parts[:, state["joint_pos"].shape[-1] : -3, None].repeat(1, 1, 3)
        commanded[:, 0] = torch.maximum(commanded[:, 0], parts[:, [-3, -3, -2]])
        bodies = commanded.amax(-1).sum(-1)
        return (errors * commanded).flatten(1).sum(-1) / bodies.clamp_min(1.0), bodies > 0

    return error


def commanded_anchor_pos_error(anchor: int) -> _PartialError:
    """Return the squared distance ``[N]`` (m^2, world) of the anchor, and whether its position is commanded."""

    def error(state: TensorDictBase, reference: TensorDictBase, parts: Tensor) -> tuple[Tensor, Tensor]:
        return anchor_pos_error(state, reference, anchor), parts[:, state["joint_pos"].shape[-1] + anchor] > 0

    return error


def commanded_rot_error(state: TensorDictBase, reference: TensorDictBase, parts: Tensor) -> tuple[Tensor, Tensor]:
    """Return the squared angle ``[N]`` (rad^2) of the root, and whether its orientation is commanded."""
    return anchor_rot_error(state, reference, anchor=0), parts[:, -1] > 0


def commanded_ang_vel_error(state: TensorDictBase, reference: TensorDictBase, parts: Tensor) -> tuple[Tensor, Tensor]:
    """Return the squared error ``[N]`` ((rad/s)^2) of the root's turning, and whether its orientation is commanded."""
    error = state["keypoint_ang_vel_w"][:, 0] - reference["keypoint_ang_vel_w"][:, 0]
    return error.square().sum(-1), parts[:, -1] > 0


def anchor_pos_error(state: TensorDictBase, reference: TensorDictBase, anchor: int) -> Tensor:
    """Return the squared distance ``[N]`` (m^2, world) of the anchor body from its reference."""
    return (state["keypoint_pos_w"][:, anchor] - reference["keypoint_pos_w"][:, anchor]).square().sum(-1)


def anchor_rot_error(state: TensorDictBase, reference: TensorDictBase, anchor: int) -> Tensor:
    """Return the squared angle ``[N]`` (rad^2) between the anchor body and its reference."""
    return quat_angle(state["keypoint_quat_w"][:, anchor], reference["keypoint_quat_w"][:, anchor]).square()


def keypoint_rot_error(state: TensorDictBase, reference: TensorDictBase) -> Tensor:
    """Return the mean over keypoints of the squared angle ``[N]`` (rad^2) to the aligned reference."""
    return quat_angle(state["keypoint_quat_w"], reference["keypoint_quat_aligned_w"]).square().mean(-1)


def limit_excess(joint_pos: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """Return the sum over joints ``[N]`` (rad) of the angles beyond the limits."""
    return ((low - joint_pos).clamp_min(0) + (joint_pos - high).clamp_min(0)).sum(-1)


def last_action(before: TensorDictBase) -> Tensor:
    """Return the action ``[N, J]`` of the step before, of entries before a step."""
    last: Tensor = table().entry("robot", "last_action").quantity(before["robot", "last_action"])
    return last


def foot_slip(state: TensorDictBase, feet: list[int], loaded: float = 5.0) -> Tensor:
    """Return the sum over feet ``[N]`` ((m/s)^2) of the squared horizontal speed of those loaded over ``loaded`` N."""
    speed = state["keypoint_lin_vel_w"][:, feet, :2].square().sum(-1)
    return (speed * (state["foot_force"] > loaded)).sum(-1)
