"""Fuzzing of every reader with spoilt files: ``python -m tests.fuzz.fuzz --seconds 300``.

Each case has a seed of its own, so that ``--only NAME --case NUMBER`` repeats it. Cases are read in a child process
under limits; one that ends or hangs it is a fault too.
"""

import argparse
import json
import os
import random
import select
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tests.fuzz.bombs import BOMBS
from tests.fuzz.mutations import MUTATIONS
from tests.fuzz.readers import Subject, subjects
from tests.fuzz.watch import MOST_SECONDS, forbid_programs, limit_process, read_under_limits

__all__ = ["Report", "fuzz"]

_STUCK = 3 * MOST_SECONDS
"""Seconds of the processor without an answer after which the child is stuck where no alarm reaches it."""


@dataclass
class Report:
    """Figures of a campaign.

    Attributes:
        read: by subject, files that were read.
        refused: by subject, files that were refused in one line.
        faults: by subject, fault and place: the cases.
        slowest: seconds, subject and case of the slowest read.
        largest: bytes, subject and case of the read that took most memory.
    """

    read: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    faults: dict[tuple[str, str, str], list[int]] = field(default_factory=dict)
    slowest: tuple[float, str, int] = (0.0, "", 0)
    largest: tuple[int, str, int] = (0, "", 0)

    @property
    def files(self) -> int:
        """Return how many files were tried."""
        return self.read.total() + self.refused.total() + sum(map(len, self.faults.values()))

    def lines(self) -> list[str]:
        """Return the figures as text."""
        rows = [f"{'subject':<34} {'read':>8} {'refused':>8} {'faults':>8}"]
        faults: Counter[str] = Counter()
        for (name, _, _), cases in self.faults.items():
            faults[name] += len(cases)
        for name in sorted({*self.read, *self.refused, *faults}):
            rows.append(f"{name:<34} {self.read[name]:>8} {self.refused[name]:>8} {faults[name]:>8}")
        rows.append(f"{'all':<34} {self.read.total():>8} {self.refused.total():>8} {faults.total():>8}")
        rows.append(f"slowest: {self.slowest[0]:.2f} s ({self.slowest[1]}, case {self.slowest[2]})")
        rows.append(f"largest: {self.largest[0] / 1e6:.0f} MB ({self.largest[1]}, case {self.largest[2]})")
        for (name, fault, where), cases in sorted(self.faults.items(), key=lambda row: -len(row[1])):
            rows.append(f"FAULT {len(cases)} x {name}: {fault} at {where} (cases {', '.join(map(str, cases[:5]))})")
        return rows


def fuzz(seconds: float = 60.0, seed: int = 0, only: str = "", cases: Sequence[int] = (), most: int = 10**9) -> Report:
    """Read spoilt files of all readers in turn.

    Args:
        seconds: to go on for.
        seed: of all cases.
        only: name of the subject to try, or a part of several names.
        cases: numbers of the cases to try; by default 0, 1, 2 ... Negative ones are the bombs of a file's ending.
        most: number of cases of each subject.
    """
    known = subjects()
    chosen = [subject for subject in known if subject.name == only] or [row for row in known if only in row.name]
    jobs = [
        (case, index) for case in (cases or range(most if most < 10**9 else 100_000)) for index in range(len(chosen))
    ]
    report, ends, first = Report(), time.monotonic() + seconds, 0
    while first < len(jobs) and time.monotonic() < ends:
        first = _run_child(chosen, jobs, first, seed, ends, report)
    return report


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
    report.slowest = max(report.slowest, (answer["seconds"], name, case))
    report.largest = max(report.largest, (answer["memory"], name, case))


def _child(chosen: list[Subject], jobs: list[tuple[int, int]], first: int, seed: int, ends: float, send: int) -> None:
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    warnings.simplefilter("ignore")
    limit_process()
    forbid_programs()
    base = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir=base))
    try:
        for case, index in jobs[first:]:
            if time.monotonic() > ends:
                break
            subject = chosen[index]
            write_case(subject, folder, seed, case)
            outcome = read_under_limits(subject.read, folder / subject.start if subject.start else folder)
            os.write(send, json.dumps(asdict(outcome)).encode() + b"\n")
    finally:
        for path in folder.iterdir():
            path.unlink()
        folder.rmdir()


def write_case(subject: Subject, folder: Path, seed: int, case: int) -> None:
    """Write the files of a case into a folder: a valid one, and what a case makes of it."""
    rng = random.Random(f"{seed} {subject.name} {case}")
    content = subject.files[subject.target]
    suffix = Path(subject.target).suffix
    bombs = BOMBS.get(suffix, ())
    if case < 0:
        spoilt = bombs[-1 - case](rng, content) if -case <= len(bombs) else content
    elif bombs and rng.random() < 0.02:
        spoilt = rng.choice(bombs)(rng, content)
    else:
        spoilt = MUTATIONS[subject.kind](rng, content)
    for name, whole in subject.files.items():
        (folder / name).write_bytes(spoilt if name == subject.target else whole)
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
    arguments = parser.parse_args()
    report = fuzz(arguments.seconds, arguments.seed, arguments.only, arguments.case)
    print("\n".join(report.lines()))
    return 1 if report.faults else 0


if __name__ == "__main__":
    sys.exit(main())
