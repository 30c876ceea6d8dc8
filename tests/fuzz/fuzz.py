"""Fuzzing of every reader with spoiled files: ``python -m tests.fuzz.fuzz --seconds 300``.

Each case has a seed of its own, so that ``--only NAME --case NUMBER`` repeats it. Cases are read in a child process
under limits; one that ends or hangs it is a fault too. ``--even`` gives every reader the same time, and not the same
number of files: the quick ones read many.
"""

import argparse
import json
import os
import random
import select
import signal
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from plat.scratch import Scratch
from tests.fuzz.bombs import BOMBS
from tests.fuzz.mutations import MUTATIONS
from tests.fuzz.readers import Subject, subjects
from tests.fuzz.watch import MOST_SECONDS, forbid_programs, limit_process, read_under_limits

__all__ = ["Report", "fuzz"]

_FIRST, _MOST_IN_A_WAVE = 4, 100
"""Files of a reader before its cost is known, and after it in one wave."""
_WAVE = 30.0
"""Seconds of the processor that a wave is to take."""
_STUCK = 3 * MOST_SECONDS
"""Seconds of the processor without an answer after which the child is stuck where no alarm reaches it."""


@dataclass
class Report:
    """Figures of a campaign.

    Attributes:
        read: by subject, files that were read.
        refused: by subject, files that were refused in one line.
        faults: by subject, fault and place: the cases.
        seconds: of the processor by subject, for making files and reading them.
        slowest: seconds, subject and case of the slowest read.
        largest: bytes, subject and case of the read that took most memory.
    """

    read: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    faults: dict[tuple[str, str, str], list[int]] = field(default_factory=dict)
    seconds: Counter[str] = field(default_factory=Counter)
    slowest: tuple[float, str, int] = (0.0, "", 0)
    largest: tuple[int, str, int] = (0, "", 0)

    @property
    def files(self) -> int:
        """Return how many files were tried."""
        return self.read.total() + self.refused.total() + self.faulty.total()

    @property
    def faulty(self) -> Counter[str]:
        """Return how many files of each subject were faults."""
        found: Counter[str] = Counter()
        for (name, _, _), cases in self.faults.items():
            found[name] += len(cases)
        return found

    def cost(self, name: str) -> float:
        """Return the mean seconds of the processor that a file of a subject takes."""
        return self.seconds[name] / max(1, self.read[name] + self.refused[name] + self.faulty[name])

    def lines(self) -> list[str]:
        """Return the figures as text."""
        rows = [f"{'subject':<34} {'read':>8} {'refused':>8} {'faults':>8} {'ms each':>8}"]
        faults = self.faulty
        for name in sorted({*self.read, *self.refused, *faults}):
            cost = 1000 * self.cost(name)
            rows.append(f"{name:<34} {self.read[name]:>8} {self.refused[name]:>8} {faults[name]:>8} {cost:>8.1f}")
        rows.append(f"{'all':<34} {self.read.total():>8} {self.refused.total():>8} {faults.total():>8}")
        rows.append(f"slowest: {self.slowest[0]:.2f} s ({self.slowest[1]}, case {self.slowest[2]})")
        rows.append(f"largest: {self.largest[0] / 1e6:.0f} MB ({self.largest[1]}, case {self.largest[2]})")
        for (name, fault, where), cases in sorted(self.faults.items(), key=lambda row: -len(row[1])):
            rows.append(f"FAULT {len(cases)} x {name}: {fault} at {where} (cases {', '.join(map(str, cases[:5]))})")
        return rows


def fuzz(
    seconds: float = 60.0,
    seed: int = 0,
    only: str = "",
    cases: Sequence[int] = (),
    most: int = 10**9,
    even: bool = False,
    enough: Callable[[Report], bool] = lambda _: False,
) -> Report:
    """Read spoiled files of all readers in turn.

    Args:
        seconds: to go on for.
        seed: of all cases.
        only: name of the subject to try, or a part of several names.
        cases: numbers of the cases to try; by default 0, 1, 2 ... Negative ones are the bombs of a file's ending.
        most: number of cases of each subject.
        even: whether subjects get the same time rather than the same number of files.
        enough: is given the figures from time to time, and says whether they suffice.
    """
    known = subjects()
    chosen = [subject for subject in known if subject.name == only] or [row for row in known if only in row.name]
    report, ends = Report(), time.monotonic() + seconds
    for jobs in _waves(chosen, cases, most, report, even):
        first = 0
        while first < len(jobs) and time.monotonic() < ends:
            first = _run_child(chosen, jobs, first, seed, ends, report)
        if enough(report) or time.monotonic() >= ends:
            break
    return report


def _waves(
    chosen: list[Subject], cases: Sequence[int], most: int, report: Report, even: bool
) -> Iterator[list[tuple[int, int]]]:
    """Yield jobs: pairs of a case and the number of a subject."""
    if cases:
        yield [(case, index) for case in cases for index in range(len(chosen))]
        return
    done = [0] * len(chosen)
    while min(done) < most:
        jobs = []
        for index, subject in enumerate(chosen):
            share = _share(report.cost(subject.name), len(chosen)) if even and done[index] else _FIRST
            count = min(share, most - done[index])
            jobs += [(case, index) for case in range(done[index], done[index] + count)]
            done[index] += count
        # in turn: a campaign that ends early has tried all subjects
        yield jobs if even else sorted(jobs)


def _share(cost: float, subjects: int) -> int:
    """Return the number of files in a wave of a reader that takes so many seconds for each."""
    return max(1, round(min(_MOST_IN_A_WAVE, _WAVE / subjects / max(cost, 1e-9))))


def _run_child(
    chosen: list[Subject], jobs: list[tuple[int, int]], first: int, seed: int, ends: float, report: Report
) -> int:
    """Read files in a child process until it ends; return the number of the next job."""
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(receive)
        try:
            _child(chosen, jobs, first, seed, ends, send)
        finally:
            os._exit(0)
    os.close(send)
    stuck, spent = False, 0.0
    with os.fdopen(receive, "rb") as pipe:
        while not stuck:
            # readline below takes more than one answer from the pipe at a time, but the child waits for none of them
            ready, _, _ = select.select([pipe], [], [], 1.0)
            if not ready:
                stuck = _processor_seconds(child) - spent > _STUCK
                continue
            spent = _processor_seconds(child)
            line = pipe.readline()
            if not line:
                break
            _note(report, chosen, jobs, first, json.loads(line))
            first += 1
    if stuck:
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if first < len(jobs) and (stuck or status):
        case, index = jobs[first]
        fault = "stuck where no alarm reaches" if stuck else f"ended the process ({status})"
        report.faults.setdefault((chosen[index].name, fault, "outside of Python"), []).append(case)
        first += 1
    return first


def _processor_seconds(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _note(report: Report, chosen: list[Subject], jobs: list[tuple[int, int]], number: int, answer: dict) -> None:
    case, index = jobs[number]
    name = chosen[index].name
    if answer["fault"]:
        report.faults.setdefault((name, answer["fault"], answer["where"]), []).append(case)
    else:
        (report.refused if answer["refused"] else report.read)[name] += 1
    report.seconds[name] += answer["spent"]
    report.slowest = max(report.slowest, (answer["seconds"], name, case))
    report.largest = max(report.largest, (answer["memory"], name, case))


def _child(chosen: list[Subject], jobs: list[tuple[int, int]], first: int, seed: int, ends: float, send: int) -> None:
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    warnings.simplefilter("ignore")
    limit_process()
    forbid_programs()
    scratch = Scratch("plat-fuzz-", Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else None)
    folder = scratch.path / "files"
    folder.mkdir()
    try:
        for case, index in jobs[first:]:
            if time.monotonic() > ends:
                break
            subject, began = chosen[index], time.process_time()
            write_case(subject, folder, seed, case)
            outcome = read_under_limits(subject.read, folder / subject.start if subject.start else folder)
            answer = {**asdict(outcome), "spent": time.process_time() - began}
            os.write(send, json.dumps(answer).encode() + b"\n")
    finally:
        scratch.remove()


def write_case(subject: Subject, folder: Path, seed: int, case: int) -> None:
    """Write the files of a case into a folder: a valid one, and what a case makes of it."""
    rng = random.Random(f"{seed} {subject.name} {case}")
    content = subject.files[subject.target]
    suffix = Path(subject.target).suffix
    bombs = BOMBS.get(suffix, ())
    if case < 0:
        spoiled = bombs[-1 - case](rng, content) if -case <= len(bombs) else content
    elif bombs and rng.random() < 0.02:
        spoiled = rng.choice(bombs)(rng, content)
    else:
        spoiled = MUTATIONS[subject.kind](rng, content)
    for name, whole in subject.files.items():
        (folder / name).write_bytes(spoiled if name == subject.target else whole)
    for path in folder.iterdir():
        if path.name not in subject.files:
            path.unlink()


def main() -> int:
    """Run from the command line; 1 when there were faults."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="part of the names of subjects")
    parser.add_argument("--case", type=int, nargs="*", default=(), help="numbers of cases to repeat")
    parser.add_argument("--even", action="store_true", help="as much time for each subject, not as many files")
    parser.add_argument("--files", type=int, default=0, help="stop after so many")
    parser.add_argument("--log", type=Path, help="file for the figures as they are so far")
    arguments = parser.parse_args()

    def enough(report: Report) -> bool:
        if arguments.log:
            arguments.log.write_text("\n".join(report.lines()) + "\n")
        return 0 < arguments.files <= report.files

    chosen = arguments.seconds, arguments.seed, arguments.only, arguments.case
    report = fuzz(*chosen, even=arguments.even, enough=enough)
    print("\n".join(report.lines()))
    return 1 if report.faults else 0


if __name__ == "__main__":
    sys.exit(main())
