"""Cells of a comparison: policies times conditions, in parts, on all cores, kept on disk and taken up again."""

import functools
import hashlib
import re
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import torch

from plat.collectors.worker import for_workers
from plat.errors import ActionError, RecordsError
from plat.evaluation.clip_records import ClipRecords
from plat.evaluation.entrant import Entrant
from plat.evaluation.records import CommandRecords
from plat.evaluation.setting import EvaluationSetting
from plat.files import clear_parts, readable
from plat.motions.library import MotionLibrary
from plat.pools import HelperPool, available_cpus, may_start_processes, told_if_killed
from plat.progress import Progress
from plat.robots import G1, register_robot
from plat.robots.registry import registered_robots
from plat.robots.robot import Robot
from plat.runs.interrupts import ENDING
from plat.runs.user_modules import import_modules
from plat.scratch import Scratch
from plat.version import __version__
from plat.words import counted

__all__ = [
    "PART",
    "Candidate",
    "Cell",
    "Records",
    "evaluate_cells",
    "fingerprint",
    "motions_fingerprint",
    "of_others",
    "robot_fingerprint",
]

PART = 512
"""Clips of a part, at most. Parts are the same whatever the number of processes, so the records are as well."""

_WORTH_PROCESSES = 50_000  # control steps

Records: TypeAlias = CommandRecords | ClipRecords


@dataclass(frozen=True)
class Candidate:
    """Candidate of a comparison: a policy that any process can load.

    Attributes:
        name: in tables and figures.
        load: returns it; it can be pickled, such as ``functools.partial(Entrant.of_run, path)``.
        fingerprint: of its weights and of how it is shown its reference, see :func:`fingerprint`.
        weights: SHA-256 of its weights, for people.
        made_by: what made it, for people.
        trained_on: the motions that it was trained on, for people.
        filed: name in the names of its files of records, where another candidate's name makes the same; else empty.
    """

    name: str
    load: Callable[[], Entrant]
    fingerprint: str
    weights: str = ""
    made_by: str = ""
    trained_on: str = ""
    filed: str = ""


@dataclass(frozen=True)
class Cell:
    """Cell of a comparison: a candidate under some conditions.

    Attributes:
        candidate: the policy.
        horizon: name of the commands' horizon.
        setting: conditions.
        rule: of whole-clip success; None for scores of commands.
        label: what tells cells of a candidate and horizon apart, in names of files.
        clips: numbers of the motions that are followed; None for all.
    """

    candidate: Candidate
    horizon: str
    setting: EvaluationSetting = EvaluationSetting()
    rule: str | None = None
    label: str = ""
    clips: tuple[int, ...] | None = None

    @property
    def stem(self) -> str:
        """Return the name of its file of records, without ending."""
        words = (self.candidate.filed or self.candidate.name, self.horizon, self.rule, self.label)
        return "-".join(re.sub(r"[^\w.]+", "_", word).strip("_") for word in words if word)

    def about(self, motions: str, robot: str = "") -> dict[str, Any]:
        """Return what its records depend on, with the fingerprints of motions and robot."""
        # devices and threads round differently at most
        setting = replace(self.setting, num_threads=None, device="cpu")
        about = {
            "policy": self.candidate.fingerprint,
            "motions": motions,
            "horizon": self.horizon,
            "seed": setting.seed,
            "setting": repr(setting),
            "plat": __version__,
        }
        if robot:
            about["robot"] = robot
        if self.rule is not None:
            about["rule"] = self.rule
        if self.clips is not None:
            about["clips"] = list(self.clips)
        return about

    def evaluate(self, entrant: Entrant, library: MotionLibrary, **options: Any) -> Records:
        """Return the records of the candidate, which was loaded before.

        Raises:
            ActionError: for actions that mean nothing, with the candidate's name.
        """
        try:
            if self.rule is None:
                return entrant.evaluate(library, self.horizon, self.setting, **options)
            return entrant.evaluate_clips(library, self.rule, self.horizon, self.setting, **options)
        except ActionError as error:
            raise ActionError(f"{self.candidate.name}: {error}") from error

    def load(self, path: Path) -> tuple[Records, dict[str, Any]]:
        """Return the records in a file and what they depend on."""
        return CommandRecords.load(path) if self.rule is None else ClipRecords.load(path)

    def joined(self, parts: Sequence[Any]) -> Records:
        """Return the records of several parts as one table."""
        return CommandRecords.joined(parts) if self.rule is None else ClipRecords.joined(parts)


def evaluate_cells(
    cells: Sequence[Cell],
    library: MotionLibrary,
    *,
    folder: Path | None = None,
    workers: int | None = None,
    modules: Sequence[str] = (),
    what: str = "evaluation",
) -> Iterator[tuple[Cell, Records]]:
    """Yield every cell with its records, in the given order, as soon as it is done.

    A cell is evaluated in parts of :data:`PART` clips, spread over processes. With a folder, finished parts are kept
    there: an evaluation that was stopped goes on where it was, and finished cells are not evaluated again. Progress is
    shown on standard error. The signal TERM and a terminal that is closed end it as Ctrl-C does, and its processes end
    with it in any case.

    Args:
        cells: of the comparison.
        library: motions.
        folder: for the records; None keeps nothing.
        workers: processes; None for one a core where there is enough to do, and none beside this one where it may not
            start any. The records do not depend on it.
        modules: that the processes import first, see :func:`plat.runs.user_modules.import_modules`.
        what: name of the work in the progress.

    Raises:
        PlatError: what the evaluation of a cell raises.
    """
    with _stopped_by_signals(), Scratch("plat-evaluation-") as scratch:
        desk = _Desk(folder or scratch, library)
        missing = [(cell, number) for cell in cells for number in desk.missing(cell)]
        if desk.others:
            told = ", ".join(dict.fromkeys(word for words in desk.others.values() for word in words))
            files = counted(len(desk.others), "file")
            print(f"evaluated again, and replaced: {files} in {str(desk.folder)!r} of {told}")
        total = sum(desk.steps(cell, number) for cell, number in missing)
        # a process takes seconds to start
        count = min(workers or (available_cpus() if total > _WORTH_PROCESSES else 1), len(missing))
        count = count if may_start_processes() else 1
        with Progress(what, total, "control steps") as progress:
            if count > 1:
                yield from _on_processes(cells, missing, desk, scratch, count, modules, progress)
            else:
                yield from _in_process(cells, missing, desk, progress)


class _Desk:
    """Files of an evaluation: those of whole cells, and those of parts that wait for the rest of their cell."""

    def __init__(self, folder: Path, library: MotionLibrary):
        if readable(str(folder)) != str(folder):
            raise RecordsError(
                f"{str(folder)!r}: its name is no UTF-8, records cannot be read from there: choose another"
            )
        self.folder, self.library = folder, library
        clear_parts(folder)
        self._marks = motions_fingerprint(library), robot_fingerprint(library.robot)
        self.others: dict[Path, list[str]] = {}  # files that were not of a cell, and what they are of, in words

    def about(self, cell: Cell) -> dict[str, Any]:
        """Return what the records of a cell depend on."""
        return cell.about(*self._marks)

    def parts(self, cell: Cell) -> list[list[int]]:
        """Return the clips of each part of a cell: as few parts as may be, of about the same size."""
        clips = list(range(self.library.num_clips)) if cell.clips is None else list(cell.clips)
        count = -(-len(clips) // PART)
        ends = [len(clips) * number // count for number in range(count + 1)]
        return [clips[first:last] for first, last in pairwise(ends)]

    def steps(self, cell: Cell, number: int) -> int:
        """Return the control steps of a part."""
        return int((self.library.clip_length[self.parts(cell)[number]] - 1).sum())

    def whole(self, cell: Cell) -> Path:
        """Return the path of a cell's records."""
        return self.folder / f"{cell.stem}.safetensors"

    def part(self, cell: Cell, number: int) -> Path:
        """Return the path of a part's records."""
        return self.folder / f"{cell.stem}.part{number + 1:03d}of{len(self.parts(cell)):03d}.safetensors"

    def read(self, cell: Cell, path: Path) -> Records | None:
        """Return the records in a file, if there are any of this very cell."""
        if not path.exists():
            return None
        try:
            records, known = cell.load(path)
        except RecordsError as error:
            print(f"evaluated again: {error}")
            return None
        if others := of_others(known, self.about(cell)):
            self.others[path] = others
            return None
        return records

    def missing(self, cell: Cell) -> list[int]:
        """Return the parts of a cell that are not there yet."""
        if self.read(cell, self.whole(cell)) is not None:
            return []
        return [number for number in range(len(self.parts(cell))) if self.read(cell, self.part(cell, number)) is None]

    def finished(self, cell: Cell) -> Records:
        """Return a cell's records, and leave one file of them.

        Raises:
            RecordsError: when they are not there any more.
        """
        records = self.read(cell, self.whole(cell))
        paths = [self.part(cell, number) for number in range(len(self.parts(cell)))]
        if records is None:
            parts = [self.read(cell, path) for path in paths]
            if None not in parts:
                records = cell.joined(parts)
                records.save(self.whole(cell), self.about(cell))
            else:  # a process with the same cell may have been first
                records = self.read(cell, self.whole(cell))
        if records is None:
            raise RecordsError(
                f"{str(self.whole(cell))!r}: records of it are gone, or of other conditions: another process writes "
                "into the folder; wait until it ends, or choose another folder"
            )
        for path in paths:
            path.unlink(missing_ok=True)
        return records


def _in_process(
    cells: Sequence[Cell], missing: Sequence[tuple[Cell, int]], desk: _Desk, progress: Progress
) -> Iterator[tuple[Cell, Records]]:
    for cell in cells:
        numbers = [number for other, number in missing if other is cell]
        if numbers:
            entrant = cell.candidate.load()
        for number in numbers:
            before, steps = progress.done, desk.steps(cell, number)

            def told(fraction: float, before: int = before, steps: int = steps) -> None:
                progress.update(before + int(fraction * steps))

            with _one_thread():
                records = cell.evaluate(entrant, desk.library, clips=desk.parts(cell)[number], progress=told)
            records.save(desk.part(cell, number), desk.about(cell))
            progress.update(before + steps)
        yield cell, desk.finished(cell)


def _on_processes(
    cells: Sequence[Cell],
    missing: Sequence[tuple[Cell, int]],
    desk: _Desk,
    scratch: Path,
    count: int,
    modules: Sequence[str],
    progress: Progress,
) -> Iterator[tuple[Cell, Records]]:
    motions = scratch / "motions.pt"
    with for_workers(scratch):
        torch.save(desk.library.to("cpu"), motions)
    told = told_if_killed("with --out, what is done is kept")
    with told, HelperPool(count, _begin, motions, tuple(modules), registered_robots()) as pool:
        futures: dict[str, list[Future[None]]] = {}
        for cell, number in missing:
            job = (cell, desk.parts(cell)[number], desk.part(cell, number), desk.about(cell))
            future = pool.submit(_work, *job)
            future.add_done_callback(functools.partial(_told, progress, desk.steps(cell, number)))
            futures.setdefault(cell.stem, []).append(future)
        for cell in cells:
            for future in futures.pop(cell.stem, []):
                future.result()
            yield cell, desk.finished(cell)


def _told(progress: Progress, steps: int, future: "Future[None]") -> None:
    progress.add(steps)


_process: dict[str, Any] = {}
"""Motions and policies of a worker process."""


def _begin(motions: Path, modules: Sequence[str], robots: Sequence[Robot]) -> None:
    torch.set_num_threads(1)
    import_modules(modules)
    for robot in robots:  # of description files, which policies name
        register_robot(robot)
    _process["motions"] = torch.load(motions, weights_only=False, mmap=True)


def _work(cell: Cell, clips: list[int], path: Path, about: dict[str, Any]) -> None:
    key = cell.candidate.fingerprint
    if key not in _process:
        _process[key] = cell.candidate.load()
    cell = replace(cell, setting=replace(cell.setting, num_threads=1))
    cell.evaluate(_process[key], _process["motions"], clips=clips).save(path, about)


@contextmanager
def _stopped_by_signals() -> Iterator[None]:
    """Raise :class:`KeyboardInterrupt` at the signals TERM and HUP, where they would end this process as it is."""
    ours = []
    if threading.current_thread() is threading.main_thread():
        ours = [number for number in ENDING if signal.getsignal(number) == signal.SIG_DFL]
    for number in ours:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            for number in ours:
                signal.signal(number, signal.SIG_DFL)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Keep PyTorch on one thread, as in worker processes: sums over more round differently."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def fingerprint(parts: Iterable[bytes]) -> str:
    """Return a fingerprint of some bytes.

    >>> fingerprint([b"a", b"b"]) == fingerprint([b"ab"])
    False
    """
    total = hashlib.blake2b(digest_size=16)
    for part in parts:
        total.update(hashlib.blake2b(part).digest())
    return total.hexdigest()


_OTHERS = {
    "policy": "another policy",
    "motions": "other motions",
    "clips": "other motions",
    "setting": "other conditions",
    "seed": "another seed",
    "plat": "another version of plat",
    "robot": "another robot",
    "chains": "other keyframes",
    "pushes": "other pushes",
}


def of_others(known: Mapping[str, Any], about: Mapping[str, Any]) -> list[str]:
    """Return in words what records are of, where they depend on something else than is asked for; empty if on the same.

    Args:
        known: what they depend on.
        about: what is asked for.

    >>> of_others({"seed": 0, "motions": "a"}, {"seed": 0, "motions": "b", "robot": "c"})
    ['other motions', 'another robot']
    """
    differ = [key for key in {**about, **known} if key not in known or key not in about or known[key] != about[key]]
    return list(dict.fromkeys(words for key, words in _OTHERS.items() if key in differ)) or differ


def motions_fingerprint(library: MotionLibrary) -> str:
    """Return a fingerprint of the motions of a library."""
    frames = (library.frames[entry].cpu().numpy().tobytes() for entry in ("joint_pos", "keypoint_pos"))
    return fingerprint([*frames, library.clip_length.cpu().numpy().tobytes(), repr(library.dt).encode()])


def robot_fingerprint(robot: Robot) -> str:
    """Return a fingerprint of a robot, its fields and its compiled model; empty for the G1, which comes with plat.

    >>> robot_fingerprint(G1)
    ''
    """
    if robot == G1:
        return ""
    # not where its files lie
    told = {one.name: getattr(robot, one.name) for one in fields(robot) if one.name != "asset"}
    return fingerprint([repr(told).encode(), robot.compiled()])
