"""Motion library: every frame of many motions in one table, for lookups at a cost independent of its size."""

import hashlib
import json
import logging
import os
import re
import tempfile
import zlib
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from tensordict import TensorDict
from torch import Tensor

from plat.bounds import Range, check_value
from plat.errors import MotionError
from plat.files import replace_file
from plat.motions.checks.repair import clip_to_limits
from plat.motions.checks.validation import Verdict, validate_motions
from plat.motions.clip import MotionClip
from plat.motions.files import load_motions, motion_paths, read_along
from plat.motions.generation import PREFIX, generate_named
from plat.motions.mirror import mirror_motion
from plat.motions.resample import finite_difference, quat_finite_difference, resample_qpos
from plat.robots import G1, Robot
from plat.robots.kinematics import ForwardKinematics

__all__ = ["MotionLibrary", "cache_dir"]

# Frames worked on at a time while the table is built: large enough for vector speed, small enough for the cache.
_CHUNK = 16384

# Angles up to this far beyond a joint's limits are clipped when files are loaded (rad). Smoothing leaves such excesses.
_SMALL_EXCESS = 0.15

_LOGGER = logging.getLogger("plat.motions")

TABLE_VERSION = 11
"""Part of every cache key. Raise it with any change of what readers, resampling, checks or the generator produce."""


class MotionLibrary:
    """Motion library at the control rate, with all quantities for tracking.

    Clips follow each other in one table; a *frame* is a row of it. Use :meth:`from_clips` or :meth:`load`.

    Attributes:
        frames: TensorDict ``[F]`` of float32, all in the clip's world frame: ``joint_pos`` ``[J]`` (rad),
            ``joint_vel`` ``[J]`` (rad/s), ``keypoint_pos`` ``[K, 3]`` (m), ``keypoint_quat`` ``[K, 4]`` (body to
            world), ``keypoint_lin_vel`` ``[K, 3]`` (m/s, of the body's origin), ``keypoint_ang_vel`` ``[K, 3]``
            (rad/s). Keypoint 0 is the root.
        clip_names: names of the C clips.
        clip_start, clip_length: first frame and number of frames of each clip ``[C]``.
        clip_of_frame: clip of each frame ``[F]``.
        last_frame: last frame of the clip of each frame ``[F]``.
        dt: seconds from frame to frame.
        robot: whose motions they are.

    >>> from plat.motions import generate_motions
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> library.poses(torch.tensor([0, 3]))["keypoint_pos"].shape
    torch.Size([2, 14, 3])
    """

    def __init__(
        self, table: Tensor, clip_start: Tensor, clip_length: Tensor, clip_names: Sequence[str], dt: float, robot: Robot
    ):
        self.robot = robot
        self.dt = dt
        self.clip_names = list(clip_names)
        self.clip_start = clip_start
        self.clip_length = clip_length
        self.clip_of_frame = torch.repeat_interleave(torch.arange(len(clip_length), device=table.device), clip_length)
        self.last_frame = (clip_start + clip_length - 1)[self.clip_of_frame]
        self._table = table
        self._pose_width = _width(_POSE_FIELDS, robot)
        self.frames = _unpack(table, _POSE_FIELDS + _VELOCITY_FIELDS, robot)

    def __len__(self) -> int:
        return len(self._table)

    @property
    def num_clips(self) -> int:
        """Return the number of clips C."""
        return len(self.clip_names)

    @property
    def duration(self) -> float:
        """Return the length of all motions (s)."""
        return (len(self) - self.num_clips) * self.dt

    @property
    def device(self) -> torch.device:
        """Return the device of the table."""
        return self._table.device

    def to(self, device: torch.device | str) -> "MotionLibrary":
        """Return the library on another device."""
        if torch.device(device) == self.device:
            return self
        table, start, length = (t.to(device) for t in (self._table, self.clip_start, self.clip_length))
        return MotionLibrary(table, start, length, self.clip_names, self.dt, self.robot)

    def only(self, *clips: int) -> "MotionLibrary":
        """Return a library of some of the clips, in the given order.

        Raises:
            MotionError: for no clips, or one that is not there.
        """
        if not clips:
            raise MotionError("motion library: only() of no clips, expected at least one clip")
        for clip in clips:
            self._check_clip(clip)
        length = self.clip_length[list(clips)]
        starts = (int(self.clip_start[clip]) for clip in clips)
        parts = [self._table[start : start + count] for start, count in zip(starts, length.tolist(), strict=True)]
        names = [self.clip_names[clip] for clip in clips]
        return MotionLibrary(torch.cat(parts), length.cumsum(0) - length, length, names, self.dt, self.robot)

    def pieces(self, seconds: float) -> "MotionLibrary":
        """Return the same frames, with each clip that is longer than this cut into equal pieces that are not.

        A piece is called after its clip, with its number: ``NAME_0``. Velocities at a cut are those of the whole clip.

        >>> from plat.motions import generate_motions
        >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
        >>> float(library.pieces(2.0).clip_length.max() - 1) * library.dt <= 2.0
        True
        """
        most = max(2, round(seconds / self.dt) + 1)
        names: list[str] = []
        lengths: list[int] = []
        for name, length in zip(self.clip_names, self.clip_length.tolist(), strict=True):
            count = -(-length // most)
            ends = [length * number // count for number in range(count + 1)]
            lengths += [end - begin for begin, end in pairwise(ends)]
            names += [name] if count == 1 else [f"{name}_{number}" for number in range(count)]
        length = torch.tensor(lengths, device=self.device)
        return MotionLibrary(self._table, length.cumsum(0) - length, length, names, self.dt, self.robot)

    def _check_clip(self, number: int) -> None:
        if not isinstance(number, int | np.integer) or not 0 <= number < self.num_clips:
            raise MotionError(f"motion library: no clip {number!r}, expected 0 to {self.num_clips - 1}")

    def named(self, pattern: str) -> list[int]:
        """Return the indices of clips whose names match a regular expression, case-insensitively.

        Raises:
            MotionError: when the expression is broken, or is found in no name.

        >>> from plat.motions import generate_motions
        >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
        >>> library.only(*library.named("reach|walk")).clip_names
        ['reach_train_000']
        """
        try:
            expression = re.compile(pattern, re.IGNORECASE)
        except re.error as error:
            raise MotionError(f"clip names: {pattern!r} is not a regular expression ({error})") from error
        found = [clip for clip, name in enumerate(self.clip_names) if expression.search(name)]
        if not found:
            shown = ", ".join(repr(name) for name in self.clip_names[:3])
            raise MotionError(
                f"clip names: {pattern!r} is in none of the {self.num_clips}, which are called {shown} and so on"
            )
        return found

    def for_robot(self, robot: Robot) -> "MotionLibrary":
        """Return the same motions for a robot that differs in nothing but its motors.

        Raises:
            MotionError: when it has another description or other keypoints.
        """
        if (robot.asset, robot.keypoints) != (self.robot.asset, self.robot.keypoints):
            raise MotionError(f"motions of robot {self.robot.name!r}: robot {robot.name!r} has another body")
        return MotionLibrary(self._table, self.clip_start, self.clip_length, self.clip_names, self.dt, robot)

    def poses(self, frame: Tensor) -> TensorDict:
        """Return ``joint_pos``, ``keypoint_pos`` and ``keypoint_quat`` of frames ``[*B]``."""
        rows = self._table[:, : self._pose_width].index_select(0, frame.flatten())
        return _unpack(rows.view(*frame.shape, rows.shape[1]), _POSE_FIELDS, self.robot)

    def states(self, frame: Tensor) -> TensorDict:
        """Return all fields of frames ``[*B]``: poses and velocities."""
        rows = self._table.index_select(0, frame.flatten())
        return _unpack(rows.view(*frame.shape, rows.shape[1]), _POSE_FIELDS + _VELOCITY_FIELDS, self.robot)

    def qpos(self, frame: Tensor) -> Tensor:
        """Return MuJoCo position vectors ``[*B, 7 + J]`` of frames ``[*B]``."""
        poses = self.poses(frame)
        return torch.cat((poses["keypoint_pos"][..., 0, :], poses["keypoint_quat"][..., 0, :], poses["joint_pos"]), -1)

    def clip(self, number: int) -> MotionClip:
        """Return one of the clips, at the control rate.

        Raises:
            MotionError: for a number that is not from 0 to ``num_clips - 1``.

        >>> from plat.motions import generate_motions
        >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
        >>> library.clip(0).name == library.clip_names[0], library.clip(0).qpos.shape[1]
        (True, 36)
        """
        self._check_clip(number)
        start, length = int(self.clip_start[number]), int(self.clip_length[number])
        frames = torch.arange(start, start + length, device=self.device)
        return MotionClip(self.clip_names[number], self.qpos(frames).cpu().numpy(), 1 / self.dt)

    @classmethod
    def from_clips(cls, clips: Sequence[MotionClip], robot: Robot = G1, dt: float = 0.02) -> "MotionLibrary":
        """Resample clips to the control rate and compute their kinematics.

        Raises:
            MotionError: when there is no clip, or a clip is broken or lasts less than one control step.
        """
        check_value("motion library: dt", dt, Annotated[float, Range(0.001, 1)])
        if not clips:
            raise MotionError("motion library: no clips, expected at least one")
        resampled = []
        for clip in clips:
            clip = clip.checked(robot)
            qpos = resample_qpos(torch.from_numpy(clip.qpos), clip.fps, dt)
            if len(qpos) < 2:
                raise MotionError(
                    f"motion {clip.name!r}: {clip.duration:.3f} s, expected at least one control step of {dt} s"
                )
            resampled.append(qpos)
        length = torch.tensor([len(qpos) for qpos in resampled])
        start = length.cumsum(0) - length
        table = _build_table(torch.cat(resampled), start, length, dt, robot)
        return cls(table, start, length, [clip.name for clip in clips], dt, robot)

    @classmethod
    def load(
        cls,
        motions: str | Path | Sequence[str | Path],
        robot: Robot = G1,
        dt: float = 0.02,
        cache: bool = True,
        mirror: bool = False,
        drop_bad: bool = False,
    ) -> "MotionLibrary":
        """Return the library of motion files, kept on disk for the next time.

        Joint angles up to 0.15 rad beyond their limits are clipped, for no robot can reach them. Clips that go further
        are left as they are.

        Clips that :func:`~plat.motions.validate_motions` would repair or drop are counted in one warning under
        ``plat.motions``. They are measured when the table is built, and the counts are kept with it.

        Args:
            motions: paths, folders, globs, or ``"generated:train"`` (``val``, ``test``) for the motions that plat
                makes itself; see :func:`plat.motions.generation.generate_named`.
            cache: keep the finished table under :func:`cache_dir`, named by names and content of the files and of the
                code that reads or makes motions.
            mirror: add every clip's mirror image, left and right exchanged.
            drop_bad: leave out clips of files that would be dropped.

        Raises:
            MotionError: when a file is missing or broken, or no clip is left.
        """
        names = [str(name) for name in ([motions] if isinstance(motions, (str, Path)) else motions)]
        generated = [name for name in names if name.startswith(PREFIX)]
        files = [name for name in names if not name.startswith(PREFIX)]
        paths = motion_paths(files) if files else []

        def build() -> tuple["MotionLibrary", _Verdicts]:
            clips = [clip for name in generated for clip in generate_named(name, robot)]
            read = load_motions(files, robot) if files else []
            read = [_within_limits(clip.checked(robot), robot) for clip in read]
            reports = validate_motions(read, robot)
            verdicts = Counter(report.verdict for report in reports)
            if drop_bad:
                read = [clip for clip, report in zip(read, reports, strict=True) if report.verdict != "drop"]
            clips += read
            if not clips:
                raise MotionError(f"no clip is left of {len(reports)}, all would be dropped: run plat motions inspect")
            mirrored = [mirror_motion(clip.checked(robot), robot) for clip in clips] if mirror else []
            return cls.from_clips(clips + mirrored, robot, dt), dict(verdicts)

        if not cache:
            library, verdicts = build()
        else:
            content = _content_hash(generated, paths, robot, dt, mirror, drop_bad)
            cached = cache_dir() / "motions" / f"{content}.safetensors"
            known = _read_table(cached, robot)
            library, verdicts = known or build()
            if known is None:
                _write_table(cached, library, verdicts)
        _warn_of_bad_clips(verdicts, files, drop_bad)
        return library


# how many clips of the files have which verdict
_Verdicts = dict[Verdict, int]
_DONE: dict[Verdict, str] = {"drop": "dropped", "repair": "repaired"}

_POSE_FIELDS = ("joint_pos", "keypoint_pos", "keypoint_quat")
_VELOCITY_FIELDS = ("joint_vel", "keypoint_lin_vel", "keypoint_ang_vel")


def _shape(field: str, robot: Robot) -> tuple[int, ...]:
    if field.startswith("joint"):
        return (robot.num_joints,)
    return (len(robot.keypoints), 4 if field == "keypoint_quat" else 3)


def _width(fields: Sequence[str], robot: Robot) -> int:
    return sum(torch.Size(_shape(field, robot)).numel() for field in fields)


def _unpack(rows: Tensor, fields: Sequence[str], robot: Robot) -> TensorDict:
    """Return named views of packed rows ``[*B, W]``."""
    shapes = [_shape(field, robot) for field in fields]
    parts = rows.split([torch.Size(shape).numel() for shape in shapes], -1)
    batch = rows.shape[:-1]
    views = {field: part.view(*batch, *shape) for field, part, shape in zip(fields, parts, shapes, strict=True)}
    return TensorDict(views, batch, device=rows.device)


def _build_table(qpos: Tensor, start: Tensor, length: Tensor, dt: float, robot: Robot) -> Tensor:
    total = len(qpos)
    table = torch.empty(total, _width(_POSE_FIELDS + _VELOCITY_FIELDS, robot))
    frames = _unpack(table, _POSE_FIELDS + _VELOCITY_FIELDS, robot)
    kinematics = ForwardKinematics(robot)
    for begin in range(0, total, _CHUNK):
        chunk = slice(begin, begin + _CHUNK)
        root_pos, root_quat, joint_pos = qpos[chunk].split((3, 4, robot.num_joints), -1)
        keypoint_pos, keypoint_quat = kinematics(root_pos, root_quat, joint_pos)
        frames["joint_pos"][chunk] = joint_pos
        frames["keypoint_pos"][chunk] = keypoint_pos
        frames["keypoint_quat"][chunk] = keypoint_quat
    first = torch.repeat_interleave(start, length)
    last = torch.repeat_interleave(start + length - 1, length)
    for chunk in torch.arange(total).split(_CHUNK):
        before, after = (chunk - 1).maximum(first[chunk]), (chunk + 1).minimum(last[chunk])
        frames["joint_vel"][chunk] = finite_difference(frames["joint_pos"], before, after, dt)
        frames["keypoint_lin_vel"][chunk] = finite_difference(frames["keypoint_pos"], before, after, dt)
        frames["keypoint_ang_vel"][chunk] = quat_finite_difference(frames["keypoint_quat"], before, after, dt)
    return table


def _within_limits(clip: MotionClip, robot: Robot) -> MotionClip:
    """Return the clip with small excesses over joint limits clipped; a clip with a larger one is left to the checks."""
    clipped = clip_to_limits(clip, robot)
    return clipped if np.abs(clipped.qpos - clip.qpos).max() <= _SMALL_EXCESS else clip


def _warn_of_bad_clips(verdicts: _Verdicts, files: Sequence[str], dropped: bool) -> None:
    bad = [
        f"{count} {'were left out' if dropped and verdict == 'drop' else f'would be {_DONE[verdict]}'}"
        for verdict, count in sorted(verdicts.items())
        if verdict in _DONE
    ]
    if bad:
        total = sum(verdicts.values())
        _LOGGER.warning("of %d clips %s: run plat motions inspect %s", total, " and ".join(bad), " ".join(files))


def cache_dir() -> Path:
    """Return the cache folder: ``$PLAT_CACHE_DIR``, else ``plat`` in the user's cache folder or a temporary one."""
    if folder := os.environ.get("PLAT_CACHE_DIR"):
        return Path(folder)
    if folder := os.environ.get("XDG_CACHE_HOME"):
        return Path(folder) / "plat"
    try:
        return Path.home() / ".cache" / "plat"
    except RuntimeError:  # a user without a home folder, as in containers
        return Path(tempfile.gettempdir()) / "plat"


def _content_hash(
    generated: Sequence[str], paths: Sequence[Path], robot: Robot, dt: float, mirror: bool, drop_bad: bool
) -> str:
    asset = robot.asset_path.read_bytes()
    digest = hashlib.blake2b(digest_size=16)
    settings = [TABLE_VERSION, generated, robot.name, robot.keypoints, dt, mirror, drop_bad]
    digest.update(json.dumps(settings).encode())
    digest.update(hashlib.blake2b(asset).digest())
    read = [part for path in paths for part in (path, *read_along(path))]
    for path in read:
        # clips are named by their files, and a name may say the frame rate
        digest.update(path.name.encode(errors="surrogateescape") + b"\0")
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
        digest.update(b"\0")
    return digest.hexdigest()


def _write_table(path: Path, library: MotionLibrary, verdicts: _Verdicts) -> None:
    """Write a table for the next run; a full disk does not stop this one."""
    tensors = {"table": library._table, "clip_start": library.clip_start, "clip_length": library.clip_length}
    metadata = {
        "clip_names": json.dumps(library.clip_names),
        "dt": repr(library.dt),
        "verdicts": json.dumps(verdicts),
        "checksum": _checksum(*tensors.values()),
    }
    try:
        replace_file(path, lambda part: save_file(tensors, part, metadata))
    except (OSError, SafetensorError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        _LOGGER.warning("motion cache %r was not written (%s): going on without it", str(path), reason)


def _read_table(path: Path, robot: Robot) -> tuple[MotionLibrary, _Verdicts] | None:
    """Return the cached library and the verdicts on its clips, or None where there is none, or a damaged one."""
    try:
        if not path.exists():
            return None
        with safe_open(path, "pt") as file:
            metadata = file.metadata()
            table, start, length = (file.get_tensor(name) for name in ("table", "clip_start", "clip_length"))
        if metadata["checksum"] != _checksum(table, start, length):
            return None
        names, verdicts = json.loads(metadata["clip_names"]), json.loads(metadata["verdicts"])
        return MotionLibrary(table, start, length, names, float(metadata["dt"]), robot), verdicts
    except (AttributeError, OSError, RuntimeError, SafetensorError, KeyError, ValueError, TypeError):
        return None


def _checksum(*tensors: Tensor) -> str:
    checksum = 0
    for tensor in tensors:
        checksum = zlib.crc32(tensor.numpy().data, checksum)
    return f"{checksum:08x}"
