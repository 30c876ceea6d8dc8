"""Table of frames: poses and velocities of clips at the control rate, computed a chunk at a time."""

from bisect import bisect_right
from collections.abc import Callable, Sequence

import torch
from tensordict import TensorDict
from torch import Tensor

from plat.errors import MotionError
from plat.motions.clip import MotionClip
from plat.motions.resample import finite_difference, quat_finite_difference, resample_qpos
from plat.robots import Robot
from plat.robots.kinematics import ForwardKinematics

__all__ = ["FIELDS", "POSE_FIELDS", "TableBuilder", "table_width", "unpacked"]

POSE_FIELDS = ("joint_pos", "keypoint_pos", "keypoint_quat")
FIELDS = (*POSE_FIELDS, "joint_vel", "keypoint_lin_vel", "keypoint_ang_vel")
"""Fields of a row, in their order."""

# Frames worked on at a time: large enough for vector speed, small enough for the cache.
_CHUNK = 16384


class TableBuilder:
    """Builder of a table of frames. Its memory does not depend on how many clips it is given.

    Args:
        robot: whose motions they are.
        dt: seconds from frame to frame.
        write: is given the rows ``[n, W]`` in order, contiguous and of float32.
    """

    def __init__(self, robot: Robot, dt: float, write: Callable[[Tensor], object]):
        self._robot = robot
        self._dt = dt
        self._write = write
        self._kinematics = ForwardKinematics(robot)
        self.names: list[str] = []
        """Names of the clips so far."""
        self._start: list[int] = []
        self._end = 0
        self._waiting: list[Tensor] = []  # resampled, and not yet in a chunk
        self._chunk: Tensor | None = None  # its velocities lack the row behind it
        self._before = torch.empty(0, table_width(FIELDS, robot))  # the row before that chunk
        self._begin = 0  # its first row

    def add(self, clip: MotionClip) -> None:
        """Add a clip.

        Raises:
            MotionError: when it is broken or lasts less than one control step.
        """
        clip = clip.checked(self._robot)
        qpos = resample_qpos(torch.from_numpy(clip.qpos), clip.fps, self._dt)
        if len(qpos) < 2:
            raise MotionError(
                f"motion {clip.name!r}: {clip.duration:.3f} s, expected at least one control step of {self._dt} s"
            )
        self.names.append(clip.name)
        self._start.append(self._end)
        self._end += len(qpos)
        self._waiting.append(qpos)
        if self._end - self._taken >= _CHUNK:
            waiting = torch.cat(self._waiting)
            whole = len(waiting) // _CHUNK * _CHUNK
            for chunk in waiting[:whole].split(_CHUNK):
                self._take(chunk)
            self._waiting = [waiting[whole:].clone()] if whole < len(waiting) else []

    def finish(self) -> tuple[Tensor, Tensor]:
        """Write the last rows, and return first frame and number of frames of each clip ``[C]``."""
        if self._waiting:
            self._take(torch.cat(self._waiting))
            self._waiting = []
        if self._chunk is not None:
            self._emit(self._before[:0])
            self._chunk = None
        start = torch.tensor(self._start, dtype=torch.int64)
        return start, torch.tensor([*self._start[1:], self._end], dtype=torch.int64) - start

    @property
    def _taken(self) -> int:
        return self._begin + (0 if self._chunk is None else len(self._chunk))

    def _take(self, qpos: Tensor) -> None:
        """Compute the poses of the next chunk, and write the one before."""
        rows = torch.empty(len(qpos), self._before.shape[1])
        frames = unpacked(rows, FIELDS, self._robot)
        root_pos, root_quat, joint_pos = qpos.split((3, 4, self._robot.num_joints), -1)
        frames["joint_pos"][:] = joint_pos
        keypoint_pos, keypoint_quat = self._kinematics(root_pos, root_quat, joint_pos)
        frames["keypoint_pos"][:] = keypoint_pos
        frames["keypoint_quat"][:] = keypoint_quat
        if self._chunk is not None:
            self._emit(rows[:1])
            self._begin += len(self._chunk)
            self._before = self._chunk[-1:].clone()
        self._chunk = rows

    def _emit(self, behind: Tensor) -> None:
        """Compute the velocities of the waiting chunk with the row behind it, and write it."""
        chunk = self._chunk
        assert chunk is not None
        frames = unpacked(torch.cat((self._before, chunk, behind)), FIELDS, self._robot)
        row = torch.arange(self._begin, self._begin + len(chunk))
        start, end = self._edges(self._begin, self._begin + len(chunk))
        clip = torch.searchsorted(start, row, right=True) - 1
        offset = self._begin - len(self._before)
        before = (row - 1).maximum(start[clip]) - offset
        after = (row + 1).minimum(end[clip] - 1) - offset
        out = unpacked(chunk, FIELDS, self._robot)
        out["joint_vel"][:] = finite_difference(frames["joint_pos"], before, after, self._dt)
        out["keypoint_lin_vel"][:] = finite_difference(frames["keypoint_pos"], before, after, self._dt)
        out["keypoint_ang_vel"][:] = quat_finite_difference(frames["keypoint_quat"], before, after, self._dt)
        self._write(chunk)

    def _edges(self, begin: int, end: int) -> tuple[Tensor, Tensor]:
        """Return where the clips that have some of the rows start and end."""
        first, behind = bisect_right(self._start, begin) - 1, bisect_right(self._start, end - 1)
        starts = self._start[first:behind]
        following = self._start[behind] if behind < len(self._start) else self._end
        return torch.tensor(starts), torch.tensor([*starts[1:], following])


def table_width(fields: Sequence[str], robot: Robot) -> int:
    """Return the number of values W of a row with these fields."""
    return sum(torch.Size(_shape(field, robot)).numel() for field in fields)


def unpacked(rows: Tensor, fields: Sequence[str], robot: Robot) -> TensorDict:
    """Return named views of packed rows ``[*B, W]``."""
    shapes = [_shape(field, robot) for field in fields]
    parts = rows.split([torch.Size(shape).numel() for shape in shapes], -1)
    batch = rows.shape[:-1]
    views = {field: part.view(*batch, *shape) for field, part, shape in zip(fields, parts, shapes, strict=True)}
    return TensorDict(views, batch, device=rows.device)


def _shape(field: str, robot: Robot) -> tuple[int, ...]:
    if field.startswith("joint"):
        return (robot.num_joints,)
    return (len(robot.keypoints), 4 if field == "keypoint_quat" else 3)
