"""Motion library: every frame of many motions in one table, for lookups at a cost independent of its size."""

import hashlib
import json
import logging
import os
import re
import shlex
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from importlib.util import find_spec
from itertools import chain, pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from plat.bounds import Range, check_robot, check_value
from plat.errors import MotionError
from plat.files import readable
from plat.gpu import check_device
from plat.motions.cache import CODE_DIGEST, CachedTable, cache_dir, file_digests, read_table, write_table
from plat.motions.checks.repair import clip_to_limits
from plat.motions.checks.validation import MotionValidator, Verdict
from plat.motions.clip import MotionClip, as_clips
from plat.motions.files import load_motions, log, motion_paths, read_along
from plat.motions.formats.sonic import holds_sonic
from plat.motions.generation import PREFIX, generate_named
from plat.motions.mirror import mirror_motion
from plat.motions.paths import listed_paths, patterns_in
from plat.motions.resample import resampled_length
from plat.motions.store import ClipStore
from plat.motions.table import FIELDS, POSE_FIELDS, TableBuilder, table_width, unpacked
from plat.progress import tracked
from plat.robots import G1, Robot

__all__ = ["MotionLibrary", "cache_dir"]

# Angles up to this far beyond a joint's limits are clipped when files are loaded (rad). Smoothing leaves such excesses.
_SMALL_EXCESS = 0.15

_LOGGER = logging.getLogger("plat.motions")


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
        self._clip_last = clip_start + clip_length - 1
        self._table = table
        self._pose_width = table_width(POSE_FIELDS, robot)
        self.frames = unpacked(table, FIELDS, robot)

    def __len__(self) -> int:
        return len(self._table)

    def clip_of(self, frame: Tensor) -> Tensor:
        """Return the clips of frames ``[*B]``, in a time that hardly depends on the size of the library.

        >>> from plat.motions import generate_motions
        >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
        >>> library.clip_of(torch.tensor([0, len(library) - 1])).tolist() == [0, library.num_clips - 1]
        True
        """
        return torch.searchsorted(self.clip_start, frame.contiguous(), right=True) - 1

    def last_of(self, frame: Tensor) -> Tensor:
        """Return the last frames of the clips of frames ``[*B]``; see :meth:`clip_of`."""
        return self._clip_last[self.clip_of(frame)]

    @cached_property
    def clip_of_frame(self) -> Tensor:
        """Return the clip of each frame ``[F]``: a table of 8 bytes a frame, made when first asked for.

        :meth:`clip_of` does without.
        """
        clips = torch.arange(self.num_clips, device=self.device)
        return torch.repeat_interleave(clips, self.clip_length)

    @cached_property
    def last_frame(self) -> Tensor:
        """Return the last frame of each frame's clip ``[F]``: a table of 8 bytes a frame, made when first asked for.

        :meth:`last_of` does without.
        """
        return torch.repeat_interleave(self._clip_last, self.clip_length)

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
        """Return the library on another device.

        Raises:
            ConfigError: for one that this machine does not have.
        """
        if check_device(device) == self.device:
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
        return unpacked(rows.view(*frame.shape, rows.shape[1]), POSE_FIELDS, self.robot)

    def states(self, frame: Tensor) -> TensorDict:
        """Return all fields of frames ``[*B]``: poses and velocities."""
        rows = self._table.index_select(0, frame.flatten())
        return unpacked(rows.view(*frame.shape, rows.shape[1]), FIELDS, self.robot)

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
    def from_clips(
        cls, clips: MotionClip | Iterable[MotionClip], robot: Robot = G1, dt: float = 0.02
    ) -> "MotionLibrary":
        """Resample clips to the control rate and compute their kinematics; a clip alone is a list of one.

        Raises:
            MotionError: when there is no clip, or a clip is broken or lasts less than one control step.
        """
        check_robot(robot)
        check_value("motion library: dt", dt, Annotated[float, Range(0.001, 1)])
        clips = as_clips(clips, "motion library")
        if not clips:
            raise MotionError("motion library: no clips, expected at least one")
        return cls._built(clips, _frames(clips, dt), robot, dt)

    @classmethod
    def _built(cls, clips: Iterable[MotionClip], most: int, robot: Robot, dt: float) -> "MotionLibrary":
        """Return the library of clips that have so many frames at the control rate, or fewer."""
        table = torch.empty(most, table_width(FIELDS, robot))
        filled = 0

        def write(rows: Tensor) -> None:
            nonlocal filled
            table[filled : filled + len(rows)] = rows
            filled += len(rows)

        builder = TableBuilder(robot, dt, write)
        for clip in clips:
            builder.add(clip)
        start, length = builder.finish()
        return cls(table if filled == most else table[:filled].clone(), start, length, builder.names, dt, robot)

    @classmethod
    def load(
        cls,
        motions: str | Path | Sequence[str | Path],
        robot: Robot = G1,
        dt: float = 0.02,
        cache: bool = True,
        mirror: bool = False,
        drop_bad: bool = False,
        found: list[Path] | None = None,
    ) -> "MotionLibrary":
        """Return the library of motion files, kept on disk for the next time.

        Joint angles up to 0.15 rad beyond their limits are clipped, for no robot can reach them. Clips that go further
        are left as they are.

        Clips that :func:`~plat.motions.validate_motions` would repair or drop are counted in one warning under
        ``plat.motions``. They are measured when the table is built, and the counts are kept with it.

        The finished table is memory-mapped: rows are read from disk when they are first looked at, and processes share
        them. It is built a part at a time, so a library may be larger than the memory.

        Args:
            motions: paths, folders, globs, or ``"generated:train"`` (``val``, ``test``) for the motions that plat
                makes itself; see :func:`plat.motions.generation.generate_named`.
            cache: keep the finished table under :func:`cache_dir`, named by content and names of the files, the names
                of their folders, the robot, and the code that reads or makes motions.
            mirror: add every clip's mirror image, left and right exchanged.
            drop_bad: leave out clips of files that would be dropped.
            found: is given the files that the paths, folders and globs name.

        Raises:
            MotionError: when a file is missing or broken, or no clip is left.
        """
        check_robot(robot)
        check_value("motion library: dt", dt, Annotated[float, Range(0.001, 1)])
        names = [str(name) for name in patterns_in(motions)]
        if not names:
            raise MotionError("motion library: no motions, expected at least one file")
        generated = [name for name in names if name.startswith(PREFIX)]
        files = [name for name in names if not name.startswith(PREFIX)]
        paths = motion_paths(files) if files else []
        if found is not None:
            found += paths

        path = None
        if cache:
            content = _content_hash(generated, files, paths, robot, dt, mirror, drop_bad)
            path = cache_dir() / "motions" / f"{content}.safetensors"
        cached = None if path is None else read_table(path)
        if cached is None:
            source = _Source(generated, files, robot, mirror, drop_bad)
            cached = None if path is None else _write(path, source, paths, robot, dt)
            if cached is None:
                library = cls._built(source.clips(), source.most_frames(dt), robot, dt)
                _warn_of_bad_clips(source.verdicts, files, drop_bad)
                return library
            if path is not None and path.stem != _content_hash(generated, files, paths, robot, dt, mirror, drop_bad):
                # files that changed while they were read may be in it as they were before or after
                with suppress(OSError):
                    path.unlink()
        else:
            _say_again(cached.facts, paths)
        library = cls(cached.rows, cached.start, cached.length, cached.names, cached.dt, robot)
        _warn_of_bad_clips(cached.facts["verdicts"], files, drop_bad)
        return library


class _Source:
    """Clips of a library, in order: generated ones, those of files, and the mirror images."""

    def __init__(self, generated: Sequence[str], files: Sequence[str], robot: Robot, mirror: bool, drop_bad: bool):
        self._robot, self._mirror, self._drop_bad = robot, mirror, drop_bad
        self._generated = [clip for name in generated for clip in generate_named(name, robot)]
        self.said: list[tuple[int, str]] = []
        """What was logged about the files, each with its level."""
        store = ClipStore(cache_dir() / "motions")
        self._read = load_motions(files, robot, store=store, say=self._say) if files else []
        self.verdicts: Counter[Verdict] = Counter()
        """How many clips of the files have which verdict, once all were asked for."""

    def _say(self, level: int, line: str) -> None:
        log(level, line)
        self.said.append((level, line))

    def most_frames(self, dt: float) -> int:
        """Return how many frames there are if no clip is dropped."""
        return _frames([*self._generated, *self._read], dt) * (2 if self._mirror else 1)

    def clips(self) -> Iterator[MotionClip]:
        """Return the clips, one after the other.

        Raises:
            MotionError: when one is broken, or none is left.
        """
        self.verdicts.clear()
        kept: list[MotionClip] = []
        yield from self._generated
        validator = MotionValidator(self._robot)
        for read in tracked(self._read, "checking motions", unit="clips"):
            clip = self._limited(read)
            verdict = validator(clip).verdict
            self.verdicts[verdict] += 1
            if not (self._drop_bad and verdict == "drop"):
                kept.append(read)
                yield clip
        if not (kept or self._generated):
            total = self.verdicts.total()
            raise MotionError(f"no clip is left of {total}, all would be dropped: run plat motions inspect")
        if self._mirror:
            for clip in chain(self._generated, map(self._limited, kept)):
                yield mirror_motion(clip.checked(self._robot), self._robot)

    def _limited(self, clip: MotionClip) -> MotionClip:
        return _within_limits(clip.checked(self._robot), self._robot)


def _write(path: Path, source: _Source, paths: Sequence[Path], robot: Robot, dt: float) -> CachedTable | None:
    """Build a table on disk and return it; None where the disk does not take it."""

    def build(write: Callable[[Tensor], object]) -> tuple[Tensor, Tensor, list[str], dict[str, object]]:
        builder = TableBuilder(robot, dt, write)
        for clip in source.clips():
            builder.add(clip)
        start, length = builder.finish()
        facts: dict[str, object] = {"verdicts": dict(source.verdicts), "said": source.said, "folders": _folders(paths)}
        return start, length, builder.names, facts

    try:
        write_table(path, table_width(FIELDS, robot), dt, build)
    except OSError as error:
        _LOGGER.warning("motion cache %r was not written (%s): going on without it", str(path), error.strerror)
        return None
    return read_table(path)


def _folders(paths: Sequence[Path]) -> list[str]:
    """Return the folders of files, each once, as they begin the files' paths."""
    return list(dict.fromkeys(f"{path.parent}{os.sep}" for path in paths))


def _say_again(facts: Mapping[str, Any], paths: Sequence[Path]) -> None:
    """Log what was logged when the files were read, with the folders that they are in now."""
    folders = dict(zip(facts["folders"], _folders(paths), strict=True))
    moved = any(old != new for old, new in folders.items())
    begins = "|".join(re.escape(old) for old in sorted(folders, key=len, reverse=True))
    for level, line in facts["said"]:
        log(level, re.sub(rf"(?<![^\s'])(?:{begins})", lambda found: folders[found[0]], line) if moved else line)


def _frames(clips: Sequence[MotionClip], dt: float) -> int:
    """Return the number of frames of clips at the control rate; broken ones are found later."""
    return sum(resampled_length(len(clip.qpos), clip.fps, dt) for clip in clips if 0 < clip.fps < float("inf"))


_DONE: dict[Verdict, str] = {"drop": "dropped", "repair": "repaired"}


def _within_limits(clip: MotionClip, robot: Robot) -> MotionClip:
    """Return the clip with small excesses over joint limits clipped; a clip with a larger one is left to the checks."""
    clipped = clip_to_limits(clip, robot)
    return clipped if np.abs(clipped.qpos - clip.qpos).max() <= _SMALL_EXCESS else clip


def _warn_of_bad_clips(verdicts: Mapping[Verdict, int], files: Sequence[str], dropped: bool) -> None:
    bad = [
        f"{count} {'were left out' if dropped and verdict == 'drop' else f'would be {_DONE[verdict]}'}"
        for verdict, count in sorted(verdicts.items())
        if verdict in _DONE
    ]
    if bad:
        total = sum(verdicts.values())
        _LOGGER.warning(
            "of %d clips %s: run plat motions inspect %s", total, " and ".join(bad), readable(shlex.join(files))
        )


def _content_hash(
    generated: Sequence[str],
    files: Sequence[str],
    paths: Sequence[Path],
    robot: Robot,
    dt: float,
    mirror: bool,
    drop_bad: bool,
) -> str:
    """Return a digest of all that the table and what is said about it depend on."""
    digest = hashlib.blake2b(digest_size=16)
    described = [robot.name, robot.keypoints, robot.feet, robot.default_qpos.tolist()]
    retargets = find_spec("mink") is not None  # of the extra, without which human motions are skipped
    digest.update(json.dumps([CODE_DIGEST, generated, described, dt, mirror, drop_bad, retargets]).encode())
    digest.update(hashlib.blake2b(robot.compiled()).digest())
    listed, folders = listed_paths(files), {folder: number for number, folder in enumerate(_folders(paths))}
    read = [(part, path) for path in paths for part in (path, *read_along(path))]
    asked = hashlib.blake2b(json.dumps([str(Path.cwd()), *generated, *files]).encode(), digest_size=16).hexdigest()
    digests = file_digests([part for part, _ in read], cache_dir() / "motions" / f"{asked}.digests.json")
    for (part, path), content in zip(read, digests, strict=True):
        # Names of files and folders name clips and may say the frame rate. Files of one folder vouch for each other's
        # rate. A bad one is refused if it was named, and skipped if it was found.
        called = part.resolve().parent.name if holds_sonic(part) else ""
        folder = folders[f"{path.parent}{os.sep}"]
        places = [part.name, part.absolute().parent.name, called, folder, path in listed]
        digest.update(json.dumps([*places, content]).encode())
    return digest.hexdigest()
