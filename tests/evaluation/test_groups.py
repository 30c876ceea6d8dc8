import pytest
import torch

from plat.errors import RecordsError
from plat.evaluation import report
from plat.evaluation.groups import group_table, score_groups
from tests.figures.scores import records


def test_groups_have_the_figures_of_their_rows():
    table = records(0.5, 0.1, 0.2)  # the first 20 of 40 fail
    labels = ["hard"] * 10 + ["calm"] * 30
    calm, hard = score_groups("PLAT", "mixed", [table], labels, order=("calm", "brisk", "hard"))
    assert (calm.group, calm.count, hard.group, hard.count) == ("calm", 30, "hard", 10)
    assert hard.figures["tks"].value == 0
    assert calm.figures["tks"].value == pytest.approx(100 * 20 / 30)
    assert calm.figures == report(table.of_rows(table.steps.new_tensor([0] * 10 + [1] * 30).bool()))


def test_the_table_has_a_column_a_group():
    scores = [
        score
        for name in ("PLAT", "wbc")
        for score in score_groups(name, "mixed", [records(0.25, 0.1, 0.2)], ["a"] * 10 + ["b"] * 30, resamples=10)
    ]
    lines = group_table(scores).splitlines()
    assert lines[0] == "| TKS@3 (%) | a (10) | b (30) |"
    assert lines[2].startswith("| PLAT | 0.0 (")
    assert lines[3].startswith("| wbc | 0.0 (")
    assert "| MPKPE@3 (mm) |" in group_table(scores, "mpkpe")


def test_a_label_too_few_is_refused():
    with pytest.raises(RecordsError, match="3 labels for 40 rows"):
        score_groups("PLAT", "mixed", [records(0.5, 0.1, 0.2)], ["a"] * 3)


def test_a_metric_that_there_is_none_of_is_named():
    (score,) = score_groups("PLAT", "mixed", [records(0.5, 0.1, 0.2)], ["a"] * 40, resamples=10)
    for name in ("success", "clip_success"):  # the second is a metric, and one of whole clips
        with pytest.raises(RecordsError, match=f"metric '{name}': expected one of tks, mpjpe.*foot_slip$"):
            group_table([score], name)


def test_every_run_has_a_row_for_each_label():
    table = records(0.5, 0.1, 0.2)
    with pytest.raises(RecordsError, match="40 labels for 3 rows"):
        score_groups("PLAT", "mixed", [table, table.of_rows(torch.arange(3))], ["a"] * 40)
    with pytest.raises(RecordsError, match="no records"):
        score_groups("PLAT", "mixed", [], ["a"] * 40)
