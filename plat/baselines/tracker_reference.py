"""Reference frames for dense trackers."""

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor

from plat.envs.transforms.base import ObservationTransform
from plat.evaluation.in_between import InBetween
from plat.evaluation.names import Interface
from plat.motions.library import MotionLibrary

__all__ = ["PlannedReference", "TrackerReference"]


def _shapes(library: MotionLibrary, ahead: Tensor) -> dict[NestedKey, tuple[int, ...]]:
    joints = library.robot.num_joints
    widths = {"joint_pos": joints, "joint_vel": joints, "root_pos_w": 3, "root_quat_w": 4}
    widths |= {"root_lin_vel_w": 3, "root_ang_vel_w": 3, "anchor_pos_w": 3}
    return {("tracker_reference", key): (*ahead.shape, width) for key, width in widths.items()}


class TrackerReference(ObservationTransform):
    """Transform that adds ``"tracker_reference"``: the reference frames of a dense tracker, in the clip's world frame.

    Entries: ``joint_pos`` ``[J]`` (rad), ``joint_vel`` ``[J]`` (rad/s), ``root_pos_w`` ``[3]`` (m), ``root_quat_w``
    ``[4]``, ``root_lin_vel_w`` ``[3]`` (m/s), ``root_ang_vel_w`` ``[3]`` (rad/s), ``anchor_pos_w`` ``[3]`` (m). For a
    tracker that is shown F frames at once, each has F rows: ``[F, J]`` and so on.

    Args:
        library: motions.
        frame: entry with the library row to start from: ``("motion", "frame")`` for dense tracking, or
            ``("command", "target_frame")`` to show a commanded keyframe as if it were the next frame.
        ahead: frames from there, or F of them; past the clip's end its last frame.
        velocities: show the reference's velocities; a keyframe has none, and then they are 0.
    """

    def __init__(
        self,
        library: MotionLibrary,
        frame: NestedKey = ("motion", "frame"),
        ahead: int | tuple[int, ...] = 1,
        velocities: bool = True,
    ):
        self._ahead = torch.tensor(ahead, device=library.device)  # [] or [F]
        super().__init__(in_keys=[frame], out_shapes=_shapes(library, self._ahead))
        self._library = library
        self._frame = frame
        self._velocities = velocities

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        frame = tensordict[self._frame].view(-1, *[1] * self._ahead.ndim)
        states = self._library.states((frame + self._ahead).minimum(self._library.last_of(frame)))
        velocities = {
            "joint_vel": states["joint_vel"],
            "root_lin_vel_w": states["keypoint_lin_vel"][..., 0, :],
            "root_ang_vel_w": states["keypoint_ang_vel"][..., 0, :],
        }
        if not self._velocities:
            velocities = {key: torch.zeros_like(value) for key, value in velocities.items()}
        entries = {
            "joint_pos": states["joint_pos"],
            "root_pos_w": states["keypoint_pos"][..., 0, :],
            "root_quat_w": states["keypoint_quat"][..., 0, :],
            "anchor_pos_w": states["keypoint_pos"][..., self._library.robot.anchor_index, :],
            **velocities,
        }
        return {("tracker_reference", key): value for key, value in entries.items()}


class PlannedReference(ObservationTransform):
    """Transform that adds ``"tracker_reference"`` from an in-between motion, as :class:`TrackerReference` has it.

    It needs :class:`plat.evaluation.in_between.Plan` before it.

    Args:
        library: motions that the keyframes are taken from.
        interface: of the in-between motion.
        ahead: frames from the current one, or several of them.
    """

    def __init__(self, library: MotionLibrary, interface: Interface, ahead: int | tuple[int, ...] = 1):
        self._ahead = torch.tensor(ahead, device=library.device)
        super().__init__(in_keys=InBetween.in_keys, out_shapes=_shapes(library, self._ahead))
        self._motion = InBetween(library, interface, (library.robot.anchor,))

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        poses = self._motion.poses(tensordict, self._ahead)
        entries = {
            "joint_pos": poses["joint_pos"],
            "root_pos_w": poses["root_pos"],
            "root_quat_w": poses["root_quat"],
            "anchor_pos_w": poses["keypoint_pos"][..., 0, :],
            **self._motion.velocities(tensordict, self._ahead),
        }
        return {("tracker_reference", key): value for key, value in entries.items()}
