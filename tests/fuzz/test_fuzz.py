"""A short run of the campaign, and each of its bombs once; ``python -m tests.fuzz.fuzz`` is the long one."""

import sys
from collections import Counter
from pathlib import Path

import pytest

from plat.errors import PlatError
from tests.fuzz import fuzz as campaign
from tests.fuzz.bombs import BOMBS
from tests.fuzz.fuzz import Report, _waves, fuzz
from tests.fuzz.readers import Subject, subjects
from tests.fuzz.watch import MOST_MEMORY

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="memory is looked up in /proc")
CASES = 3


def test_no_reader_stumbles() -> None:
    report = fuzz(120.0, seed=2, most=CASES)
    assert not report.faults, "\n".join(report.lines())
    assert report.files == CASES * len(subjects())
    assert report.read.total() > 20
    assert report.refused.total() > 60


def test_whole_files_are_read(tmp_path: Path) -> None:
    # else nothing but refusals would be tried
    for number, subject in enumerate(known for known in subjects() if " as ." not in known.name):
        folder = tmp_path / str(number)
        folder.mkdir()
        for name, content in subject.files.items():
            (folder / name).write_bytes(content)
        subject.read(folder / subject.start if subject.start else folder)


@pytest.mark.parametrize(
    "subject", ["motion plat.npz", "motion gmr.pkl", "motion headed_50fps.csv", "bvh", "asf", "amc", "keyframes"]
)
def test_bombs_of_motions(subject: str) -> None:
    assert_harmless(fuzz(120.0, only=subject, cases=BOMB_CASES))


@pytest.mark.parametrize(
    "subject",
    [
        *("skeleton map", "config.json of residual_latent", "robot", "bundle.json", "policy.onnx", "keys of a model"),
        *("model of a robot", "constraints"),
    ],
)
def test_bombs_of_other_files(subject: str) -> None:
    assert_harmless(fuzz(120.0, only=subject, cases=BOMB_CASES))


BOMB_CASES = range(-max(map(len, BOMBS.values())), 0)


def assert_harmless(report: Report) -> None:
    assert not report.faults, "\n".join(report.lines())
    assert report.largest[0] < MOST_MEMORY / 2, "\n".join(report.lines())


@pytest.fixture
def reader(monkeypatch: pytest.MonkeyPatch):
    """Put a reader of our own in the place of all others."""

    def put(read) -> None:
        subject = Subject("own", {"a.txt": b"1 2 3"}, "a.txt", "text", read, "a.txt")
        monkeypatch.setattr(campaign, "subjects", lambda: [subject])

    return put


def raise_key_error(path):
    raise KeyError("raw")


def raise_two_lines(path):
    raise PlatError("one\ntwo")


def raise_surrogate(path):
    raise PlatError("\ud800")


def take_memory(path):
    import mmap

    # not from the heap: a process that ran other tests may hold as much free memory, which would be used again
    with mmap.mmap(-1, 64 << 20) as memory:
        memory.write(bytes(64 << 20))  # pages that nobody writes to would be promised, not used


def run_program(path):
    import os

    os.system("true")


def end_process(path):
    import os

    os.kill(os.getpid(), 9)


@pytest.mark.parametrize(
    ("read", "fault"),
    [
        (raise_key_error, "raw KeyError"),
        (raise_two_lines, "message is not one printable line"),
        (raise_surrogate, "message is not one printable line"),
        (take_memory, "more than 0.031 GB"),
        (run_program, "ran a program"),
        (end_process, "ended the process (9)"),
    ],
)
def test_faults_are_seen(reader, read, fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    reader(read)
    monkeypatch.setattr("tests.fuzz.watch.MOST_MEMORY", (32 << 20) if read is take_memory else MOST_MEMORY)
    report = fuzz(60.0, most=2)
    # one kind may stand in two places: what it took, or where
    found = Counter(kind for (_, kind, _), cases in report.faults.items() for _ in cases)
    assert found == {fault: 2}


def test_hangs_are_seen(reader, monkeypatch: pytest.MonkeyPatch) -> None:
    def spin(path):
        while True:
            pass

    reader(spin)
    monkeypatch.setattr("tests.fuzz.watch.MOST_SECONDS", 0.2)
    report = fuzz(60.0, most=1)
    assert [fault for _, fault, _ in report.faults] == ["longer than 0.2 s"]


def test_a_case_is_the_same_again() -> None:
    first, second = (fuzz(60.0, seed=5, only="keyframes", most=20) for _ in range(2))
    assert (first.read, first.refused) == (second.read, second.refused)


def test_quick_readers_read_more_files_in_the_same_time() -> None:
    chosen = [Subject(name, {}, "", "text", raise_key_error, "") for name in ("quick", "slow")]
    report = Report()
    waves = _waves(chosen, (), 10**9, report, even=True)
    first = next(waves)
    assert sorted(first) == sorted((case, index) for case in range(4) for index in range(2))
    report.read.update(quick=4, slow=4)
    report.seconds.update(quick=0.4, slow=4.0)
    second = next(waves)
    count = Counter(index for _, index in second)
    assert 5 * count[1] < count[0] <= 100
    assert not set(first) & set(second)  # no case twice
    assert sorted(case for case, index in second if index == 1) == list(range(4, 4 + count[1]))


def test_a_campaign_ends_when_there_are_enough_files(reader) -> None:
    reader(raise_two_lines)
    report = fuzz(60.0, enough=lambda report: report.files >= 6)
    assert report.files == 8  # two waves of four
    assert report.seconds["own"] > 0
