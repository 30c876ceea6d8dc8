import dataclasses
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from plat.errors import RecordsError
from plat.evaluation import ClipRecords, CommandRecords, report
from tests.evaluation.test_report import records


def assert_same(a: CommandRecords, b: CommandRecords) -> None:
    torch.testing.assert_close(dataclasses.asdict(a), dataclasses.asdict(b), rtol=0, atol=0, equal_nan=True)


def test_a_table_comes_back_with_what_it_is_about(tmp_path):
    written = records(window={key: torch.tensor([0.1, 0.2, 0.3, 0.4]).double() for key in records().window})
    written.save(tmp_path / "new" / "a.safetensors", {"horizon": "long", "seed": 3})
    read, about = CommandRecords.load(tmp_path / "new" / "a.safetensors")
    assert_same(read, written)
    assert about == {"horizon": "long", "seed": 3}


def test_missing_values_survive_the_file(tmp_path):
    records().save(tmp_path / "a.safetensors", {})
    read, _ = CommandRecords.load(tmp_path / "a.safetensors")
    assert report(read) == report(records())
    assert read.window["joint_error"].isnan().tolist() == [False, False, False, True]
    assert read.arrival_error[3] == torch.inf


def test_rows_of_some_motions():
    part = records().of_clips([1])
    assert part.clip.tolist() == [1, 1]
    assert part.failed.tolist() == [False, True]
    assert part.window["keypoint_error"][0] == 0.4
    assert len(part.step["foot_slip"]) == 2
    assert_same(records().of_clips([0, 1]), records())


@pytest.mark.parametrize("content", [b"", b"nothing of the kind", None])
def test_another_file_is_named(tmp_path, content):
    path = tmp_path / "a.safetensors"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RecordsError, match="a.safetensors': not a readable file of evaluation records"):
        CommandRecords.load(path)


def test_a_safetensors_file_of_something_else_is_named(tmp_path):
    from safetensors.torch import save_file

    save_file({"weight": torch.zeros(2)}, tmp_path / "model.safetensors")
    with pytest.raises(RecordsError, match="not a readable file of evaluation records"):
        CommandRecords.load(tmp_path / "model.safetensors")


@pytest.mark.parametrize("about", ["[" * 50_000, "[1]", '{"a": 1, "a": 2}', "{"])
def test_a_broken_description(tmp_path, about):
    columns = {name: value for name, value in vars(records()).items() if isinstance(value, torch.Tensor)}
    save_file(columns, tmp_path / "a.safetensors", {"about": about})
    with pytest.raises(RecordsError, match=r"^'.*a.safetensors': [^\n]*$"):
        CommandRecords.load(tmp_path / "a.safetensors")


def test_columns_of_different_lengths(tmp_path):
    columns = {name: value for name, value in vars(records()).items() if isinstance(value, torch.Tensor)}
    save_file({**columns, "length": torch.zeros(2)}, tmp_path / "a.safetensors", {"about": "{}"})
    with pytest.raises(RecordsError, match="not a readable file of evaluation records .*different lengths"):
        CommandRecords.load(tmp_path / "a.safetensors")


def of_an_earlier_version(records: CommandRecords, path: Path) -> CommandRecords:
    """The records as they come back from a file without the columns of what was commanded, and of steps with a jerk."""
    later = ("commanded.", "jerk_steps")
    columns = {name: column for name, column in records.columns().items() if not name.startswith(later)}
    save_file(columns, path, {"about": "{}"})
    return CommandRecords.load(path)[0]


def test_a_file_that_does_not_say_what_was_commanded(tmp_path):
    path = tmp_path / "a.safetensors"
    whole = of_an_earlier_version(records(), path)
    assert whole.commanded["joints"].tolist() == whole.commanded["bodies"].tolist() == [True] * 4
    assert report(whole) == report(records())
    joints = records(
        window={name: torch.full((4,), torch.nan).double() for name in records().window}
        | {"joint_error": records().window["joint_error"]},
        arrival_error=torch.tensor([torch.nan, torch.nan, torch.nan, torch.inf]).double(),
    )
    read = of_an_earlier_version(joints, path)
    assert (read.commanded["joints"].tolist(), read.commanded["bodies"].tolist()) == ([True] * 4, [False] * 4)
    assert report(read)["mpkpe_all"].value != report(read)["mpkpe_all"].value  # NaN
    assert report(read)["mpjpe_all"] == report(records())["mpjpe_all"]


@pytest.mark.parametrize("kind", [CommandRecords, ClipRecords])
def test_no_tables_are_not_joined(kind):
    with pytest.raises(RecordsError, match="no tables of records to join"):
        kind.joined([])


@pytest.mark.parametrize("turn", [1, -1])
def test_a_column_that_not_all_have_is_not_dropped(turn):
    pieces = records(source=torch.tensor([0, 0, 0, 0]))
    with pytest.raises(RecordsError, match="not all have the column 'source'"):
        CommandRecords.joined([records(), pieces][::turn])
    assert CommandRecords.joined([pieces, pieces]).source.tolist() == [0] * 8
