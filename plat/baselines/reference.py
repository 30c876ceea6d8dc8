"""The one reference frame that a dense tracker is shown."""

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor

from plat.envs.motions.library import MotionLibrary
from plat.envs.transforms.base import ObservationTransform

__all__ = ["TrackerReference"]


class TrackerReference(ObservationTransform):
    """Adds the group ``"tracker_reference"``: the frame that the tracker takes for its next one, in the clip's world.

    Entries: ``joint_pos`` ``[J]`` (rad), ``root_pos_w`` ``[3]`` (m), ``root_quat_w`` ``[4]``, ``root_lin_vel_w``
    ``[3]`` (m/s), ``root_ang_vel_w`` ``[3]`` (rad/s), ``anchor_pos_w`` ``[3]`` (m).

    Args:
        library: motions.
        frame: entry with the library row to start from: ``("motion", "frame")`` for dense tracking, or
            ``("command", "target_frame")`` to show a commanded keyframe as if it were the next frame.
        ahead: frames from there; past the clip's end its last frame.
        velocities: show the reference's velocities; a keyframe has none, and then they are 0.
    """

    def __init__(
        self,
        library: MotionLibrary,
        frame: NestedKey = ("motion", "frame"),
        ahead: int = 1,
        velocities: bool = True,
    ):
        shapes = {"root_pos_w": 3, "root_quat_w": 4, "root_lin_vel_w": 3, "root_ang_vel_w": 3, "anchor_pos_w": 3}
        shapes["joint_pos"] = library.robot.num_joints
        super().__init__(
            in_keys=[frame], out_shapes={("tracker_reference", key): (width,) for key, width in shapes.items()}
        )
        self._library = library
        self._frame = frame
        self._ahead = ahead
        self._velocities = velocities

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        frame = tensordict[self._frame]
        states = self._library.states((frame + self._ahead).minimum(self._library.last_frame[frame]))
        lin_vel, ang_vel = states["keypoint_lin_vel"][:, 0], states["keypoint_ang_vel"][:, 0]
        entries = {
            "joint_pos": states["joint_pos"],
            "root_pos_w": states["keypoint_pos"][:, 0],
            "root_quat_w": states["keypoint_quat"][:, 0],
            "root_lin_vel_w": lin_vel if self._velocities else torch.zeros_like(lin_vel),
            "root_ang_vel_w": ang_vel if self._velocities else torch.zeros_like(ang_vel),
            "anchor_pos_w": states["keypoint_pos"][:, self._library.robot.anchor_index],
        }
        return {("tracker_reference", key): value for key, value in entries.items()}
