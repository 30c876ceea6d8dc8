import errno
import functools
import os
import signal
import tempfile
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
import torch

from plat.errors import ActionError, OutputError, PlatError, RecordsError, WorkerError
from plat.evaluation import CommandRecords, Entrant, EvaluationSetting, cells
from plat.evaluation.cells import Candidate, Cell, evaluate_cells, fingerprint, robot_fingerprint
from plat.evaluation.disturbance import Disturbance
from plat.modules import PlainPolicy
from plat.motions import MotionLibrary
from plat.robots import G1, Robot
from tests.conftest import standing_clip
from tests.figures.scores import records as made_up
from tests.modules.policies.test_student import SMALL
from tests.recipes.runs import save_run

SETTING = EvaluationSetting(num_threads=1)


@pytest.fixture(scope="module")
def clips() -> MotionLibrary:
    return MotionLibrary.from_clips(
        [standing_clip(name, frames=20 + 7 * number) for number, name in enumerate("abcde")]
    )


@pytest.fixture
def candidate(tmp_path) -> Candidate:
    run = save_run(tmp_path / "plain", PlainPolicy(G1, SMALL))
    return Candidate("a/plain", functools.partial(Entrant.of_run, run), fingerprint([b"plain"]))


@pytest.fixture
def parts_of_two(monkeypatch):
    monkeypatch.setattr(cells, "PART", 2)


@pytest.fixture
def counted(monkeypatch) -> list[list[int]]:
    """The clips of every part that is evaluated."""
    done: list[list[int]] = []
    original = Cell.evaluate

    def evaluate(self, entrant, library, **options):
        done.append(options["clips"])
        return original(self, entrant, library, **options)

    monkeypatch.setattr(Cell, "evaluate", evaluate)
    return done


def same(one: CommandRecords, other: CommandRecords) -> bool:
    columns = other.columns()
    return all(
        torch.equal(column.nan_to_num(-1.0), columns[name].nan_to_num(-1.0)) for name, column in one.columns().items()
    )


def test_parts_make_the_whole(candidate, clips, parts_of_two, counted):
    ((cell, records),) = evaluate_cells([Cell(candidate, "short", SETTING)], clips, workers=1)
    assert counted == [[0], [1, 2], [3, 4]]  # of about the same size
    whole = candidate.load().evaluate(clips, "short", SETTING)
    assert torch.equal(records.clip, whole.clip)
    assert torch.equal(records.length, whole.length)
    torch.testing.assert_close(records.window["joint_error"], whole.window["joint_error"], equal_nan=True)
    assert cell.stem == "a_plain-short"


@pytest.mark.parametrize("rule", [None, "humantracker"])
def test_actions_that_are_not_finite_are_told_with_the_name_of_the_policy(candidate, clips, rule):
    policy = PlainPolicy(G1, SMALL)
    for weights in policy.parameters():
        weights.data.fill_(torch.nan)
    broken = replace(candidate, name="broken", load=lambda: Entrant.of_policy(policy))
    found = evaluate_cells([Cell(candidate, "short", SETTING), Cell(broken, "short", SETTING, rule)], clips, workers=1)
    assert next(found)[0].candidate is candidate
    with pytest.raises(ActionError, match="^broken: the policy gave robot 0 the action nan for joint 0"):
        next(found)


def test_finished_parts_are_not_evaluated_again(candidate, clips, parts_of_two, counted, tmp_path, monkeypatch):
    cell = Cell(candidate, "short", SETTING)
    ((_, complete),) = evaluate_cells([cell], clips, workers=1)
    counted.clear()

    def stop_at_the_second(self, entrant, library, **options):
        if options["clips"] == [1, 2]:
            raise KeyboardInterrupt
        return evaluate(self, entrant, library, **options)

    evaluate = Cell.evaluate
    monkeypatch.setattr(Cell, "evaluate", stop_at_the_second)
    with pytest.raises(KeyboardInterrupt):
        list(evaluate_cells([cell], clips, folder=tmp_path / "records", workers=1))
    monkeypatch.setattr(Cell, "evaluate", evaluate)
    assert [path.name for path in (tmp_path / "records").iterdir()] == ["a_plain-short.part001of003.safetensors"]
    ((_, records),) = evaluate_cells([cell], clips, folder=tmp_path / "records", workers=1)
    assert counted == [[0], [1, 2], [3, 4]]
    assert same(records, complete)
    assert [path.name for path in (tmp_path / "records").iterdir()] == ["a_plain-short.safetensors"]
    ((_, again),) = evaluate_cells([cell], clips, folder=tmp_path / "records", workers=1)
    assert len(counted) == 3
    assert same(again, complete)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda cell: Cell(cell.candidate, "short", EvaluationSetting(seed=1)), "other conditions, another seed"),
        (
            lambda cell: Cell(cell.candidate, "short", EvaluationSetting(disturbance=Disturbance(push=1.0))),
            "other conditions",
        ),
        (lambda cell: Cell(Candidate("a/plain", cell.candidate.load, "other"), "short", SETTING), "another policy"),
    ],
    ids=["seed", "disturbance", "weights"],
)
def test_other_conditions_are_evaluated_anew(
    change: Callable[[Cell], Cell], told: str, candidate, clips, counted, tmp_path: Path, capsys
):
    """And a line says so, for the records of before are replaced."""
    cell, folder = Cell(candidate, "short", SETTING), tmp_path / "records"
    for one, times in ((cell, 1), (cell, 1), (change(cell), 2)):
        assert capsys.readouterr().out == ""
        list(evaluate_cells([one], clips, folder=folder, workers=1))
        assert len(counted) == times
    assert capsys.readouterr().out == f"evaluated again, and replaced: 1 file in {str(folder)!r} of {told}\n"


def test_a_broken_file_is_replaced(candidate, clips, counted, tmp_path, capsys):
    folder = tmp_path / "records"
    folder.mkdir()
    (folder / "a_plain-short.safetensors").write_bytes(b"nonsense")
    list(evaluate_cells([Cell(candidate, "short", SETTING)], clips, folder=folder, workers=1))
    assert len(counted) == 1
    assert "evaluated again" in capsys.readouterr().out


def test_records_that_another_process_took_are_one_line(candidate, clips, counted, tmp_path, monkeypatch):
    """Two evaluations with other conditions in one folder: their files have the same names."""
    folder, other = tmp_path / "records", EvaluationSetting(seed=1, num_threads=1)
    save = CommandRecords.save

    def raced(self, path, about):
        save(self, path, about)
        if ".part" in path.name:
            monkeypatch.setattr(CommandRecords, "save", save)
            list(evaluate_cells([Cell(candidate, "short", other)], clips, folder=folder, workers=1))

    monkeypatch.setattr(CommandRecords, "save", raced)
    with pytest.raises(RecordsError, match="a_plain-short.safetensors': records of it are gone.* another process"):
        list(evaluate_cells([Cell(candidate, "short", SETTING)], clips, folder=folder, workers=1))


def test_records_that_another_process_finished_are_taken(candidate, clips, counted, tmp_path, monkeypatch):
    folder, cell = tmp_path / "records", Cell(candidate, "short", SETTING)
    save, desks = CommandRecords.save, cells._Desk

    class Late(desks):
        def read(self, cell, path):
            found = super().read(cell, path)
            if counted and found is None and ".part" not in path.name and not late:
                late.append(path)  # the other one comes between this reading and that of the parts
                monkeypatch.setattr(cells, "_Desk", desks)
                list(evaluate_cells([cell], clips, folder=folder, workers=1))
            return found

    late: list[Path] = []
    monkeypatch.setattr(cells, "_Desk", Late)
    ((_, records),) = evaluate_cells([cell], clips, folder=folder, workers=1)
    assert late
    assert same(records, CommandRecords.load(late[0])[0])
    assert CommandRecords.save is save


def test_a_pool_that_breaks_while_it_is_given_work_is_one_line(candidate, clips, parts_of_two, monkeypatch):
    def broken(*_):
        raise BrokenProcessPool("a child process terminated abruptly")

    monkeypatch.setattr(cells.HelperPool, "submit", broken)
    with pytest.raises(WorkerError, match="a worker process was killed"):
        list(evaluate_cells([Cell(candidate, "short", SETTING)], clips, workers=2))


def test_a_daemon_evaluates_in_its_own_process(candidate, clips, parts_of_two, counted, monkeypatch):
    monkeypatch.setattr(cells, "may_start_processes", lambda: False)
    list(evaluate_cells([Cell(candidate, "short", SETTING)], clips, workers=2))
    assert len(counted) == 3


def test_a_folder_that_records_cannot_be_read_from_is_refused_before_the_work(candidate, clips, counted, tmp_path):
    folder = tmp_path / os.fsdecode(b"K\xf6ln")
    with pytest.raises(RecordsError, match=r"K\\udcf6ln': its name is no UTF-8"):
        list(evaluate_cells([Cell(candidate, "short", SETTING)], clips, folder=folder, workers=1))
    assert counted == []


def test_what_a_killed_evaluation_was_writing_is_removed(candidate, clips, tmp_path):
    folder = tmp_path / "records"
    folder.mkdir()
    (folder / f".a_plain-short.safetensors-{2**22 + 1}-12345678.part.safetensors").write_bytes(b"half")
    list(evaluate_cells([Cell(candidate, "short", SETTING)], clips, folder=folder, workers=1))
    assert [path.name for path in folder.iterdir()] == ["a_plain-short.safetensors"]


@pytest.mark.parametrize("number", [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)])
def test_signals_stop_as_ctrl_c_does(number, candidate, clips, tmp_path, monkeypatch):
    scratch: list[Path] = []

    def terminated(self, entrant, library, **options):
        scratch.extend(tmp_path.glob("plat-evaluation-*"))
        signal.raise_signal(number)

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(Cell, "evaluate", terminated)
    before = signal.signal(number, signal.SIG_DFL)  # below nohup SIGHUP is ignored, and stays so
    try:
        with pytest.raises(KeyboardInterrupt):
            list(evaluate_cells([Cell(candidate, "short", SETTING)], clips, workers=1))
        assert signal.getsignal(number) == signal.SIG_DFL
    finally:
        signal.signal(number, before)
    assert len(scratch) == 1
    assert not scratch[0].exists()


def test_a_full_disk_under_the_motions_for_processes_is_one_line(candidate, clips, parts_of_two, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(torch, "save", full)
    with pytest.raises(OutputError, match=r"motions for the workers cannot be written to '.*plat-evaluation-.*TMPDIR"):
        list(evaluate_cells([Cell(candidate, "short", SETTING)], clips, workers=2))


@pytest.mark.slow
def test_processes_give_the_records_of_one(candidate, clips, parts_of_two, tmp_path):
    wanted = [
        Cell(candidate, "short", EvaluationSetting(disturbance=Disturbance(push=0.5, motors=0.2))),
        Cell(candidate, "mixed", SETTING, rule="humantracker"),
    ]
    one = dict(evaluate_cells(wanted, clips, workers=1))
    too_far = Cell(candidate, "distant", SETTING)
    several = {}
    with pytest.raises(PlatError, match="horizon 'distant'"):  # an error in a process is told
        several.update(evaluate_cells([*wanted, too_far], clips, workers=2, folder=tmp_path / "records"))
    several = dict(evaluate_cells(wanted, clips, workers=2, folder=tmp_path / "records"))  # read, not run again
    assert list(several) == wanted
    for cell in wanted:
        assert same(one[cell], several[cell])
    assert several[wanted[1]].rule == "humantracker"


def described(folder: Path, mass: float = 1.0) -> Robot:
    """The G1 as a robot from files, with other masses."""
    folder.mkdir()
    spec = mujoco.MjSpec.from_file(str(G1.asset_path))
    for body in spec.bodies:
        body.mass *= mass
    spec.compile()
    (folder / "mine.xml").write_text(spec.to_xml())
    return replace(G1, name="mine", asset=str(folder / "mine.xml"))


def test_a_robot_from_files_is_told_by_what_is_in_them(tmp_path):
    robot = described(tmp_path / "a")
    mark = robot_fingerprint(robot)
    assert robot_fingerprint(described(tmp_path / "moved")) == mark
    assert robot_fingerprint(described(tmp_path / "b", mass=2.0)) != mark
    assert robot_fingerprint(replace(robot, root_height=0.7)) != mark
    assert robot_fingerprint(G1) == ""


def test_records_of_another_robot_are_not_used(tmp_path, monkeypatch):
    done: list[float] = []

    def evaluate(self, entrant, library, **options):
        done.append(float(library.robot.shared_model.body_mass.sum()))
        return replace(made_up(0.0, 0.1, 0.1), fell=torch.zeros(40, dtype=torch.bool))

    monkeypatch.setattr(Cell, "evaluate", evaluate)
    light, heavy = described(tmp_path / "light"), described(tmp_path / "heavy", mass=2.0)
    cell = Cell(Candidate("plain", dict, "weights"), "short", SETTING)
    for robot in (light, light, heavy, heavy, G1):
        library = MotionLibrary.from_clips([standing_clip("a", frames=20)], robot=robot)
        list(evaluate_cells([cell], library, folder=tmp_path / "records", workers=1))
    assert done == pytest.approx([33.341, 66.682, 33.341], abs=1e-3)
    _, about = CommandRecords.load(tmp_path / "records" / "plain-short.safetensors")
    assert "robot" not in about  # the G1 comes with plat
