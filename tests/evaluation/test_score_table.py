import csv

import pytest
import torch

from plat.evaluation import METRICS, Estimate, Score, differences, markdown, report, write_csv
from plat.evaluation.groups import GroupScore
from plat.evaluation.score_table import CLIP_METRICS
from plat.evaluation.study import CurvePoint, Study
from tests.evaluation.test_report import records, spread


@pytest.fixture
def scores() -> list[Score]:
    return [
        Score.of("TWIST2", "long", [records()]),
        Score.of("PLAT", "long", [records(), records(failed=records().fell)]),
        Score.of("PLAT", "mixed", [records()]),
    ]


def test_every_figure_of_the_report_has_a_name(scores):
    assert set(METRICS) == set(report(records()))
    assert scores[0].figures == report(records())


def test_csv_has_a_line_a_figure(tmp_path, scores):
    write_csv(tmp_path / "new" / "scores.csv", scores)
    with (tmp_path / "new" / "scores.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * len(METRICS)
    found = {(row["policy"], row["horizon"], row["metric"]): row for row in rows}
    assert float(found["TWIST2", "long", "tks"]["value"]) == 75
    assert found["PLAT", "long", "tks"]["seeds"] == "2"
    assert found["PLAT", "mixed", "mpkpe"]["value"] == "0.2"


def test_markdown_has_the_papers_table_and_one_a_horizon(scores):
    text = markdown(scores)
    overview, *rest = text.split("\n\n")
    lines = overview.splitlines()
    assert lines[0] == "| TKS@3 (%) / MPJPE@3 (rad) / MPKPE@3 (mm) | long | mixed |"
    assert lines[2] == "| TWIST2 | 75.0 / 0.400 / 200 |  |"  # not scored at mixed
    assert lines[3].startswith("| PLAT | 75.0 / 0.400 / 200 | 75.0")
    assert rest[0] == "**long**"
    assert rest[1].splitlines()[0] == "|  | TWIST2 | PLAT |"
    tks = scores[0].figures["tks"]
    assert f"| TKS@3 (%) | 75.0 ({tks.low:.1f}-{tks.high:.1f}) |" in rest[1]
    assert rest[1].count("\n") == len(METRICS) + 1
    assert all(line.count("|") == lines[0].count("|") for line in lines)


def test_differences_say_who_is_ahead():
    scores = [
        Score.of(name, "long", [spread(shift)]) for name, shift in (("worse", 0.02), ("better", -0.02), ("PLAT", 0))
    ]
    lines = differences(scores, "PLAT").splitlines()
    assert lines[0] == "| PLAT minus | horizon | TKS@3 (%) | MPJPE@3 (rad) | MPKPE@3 (mm) |"
    assert lines[2].startswith("| worse | long | +0.0 (+0.0 to +0.0) | **-0.020 (-0.020 to -0.020)** |")
    assert lines[3].startswith("| better | long | +0.0 (+0.0 to +0.0) | *+0.020 (+0.020 to +0.020)* |")


def test_on_one_motion_nobody_is_ahead_beyond_chance():
    """Every sample of one motion is that motion: its interval has no width, and leaves out 0."""
    ours, theirs = spread(0.0), spread(0.02)
    ours.source = theirs.source = torch.zeros(40, dtype=torch.int64)
    lines = differences([Score.of("PLAT", "long", [ours]), Score.of("other", "long", [theirs])], "PLAT").splitlines()
    assert lines[2].startswith("| other | long | +0.0 (- to -) | -0.020 (- to -) |")


def test_no_differences_without_the_policy(scores):
    assert differences(scores[:1], "PLAT") == ""


def test_an_interval_of_one_motion_is_left_out():
    """Of two pieces of one motion nothing follows for other motions: 100.0 (100.0-100.0) would claim certainty."""
    never = torch.zeros(4, dtype=torch.bool)
    one = records(failed=never, fell=never, source=torch.zeros(4, dtype=torch.int64))
    text = markdown([Score.of("mine", "long", [one])])
    assert "| TKS@3 (%) | 100.0 |" in text
    assert "| falls (%) | 0.0 |" in text
    assert "(" not in text.split("| MPJPE@3 (rad) |")[1].splitlines()[0]
    assert METRICS["tks"].text(Estimate(100.0, 39.8, 100.0)) == "100.0 (39.8-100.0)"


def test_one_miss_of_ten_thousand_is_not_rounded_away():
    most = Estimate(99.99, 99.96, 100.0)
    assert METRICS["tks"].text(most) == "99.9 (99.9-100.0)"
    assert CLIP_METRICS["clip_success"].text(100.0) == "100.0"
    assert METRICS["fall_rate"].text(Estimate(0.01, 0.0, 0.04)) == "0.1 (0.0-0.1)"
    assert METRICS["tks"].text(-0.01, "+") == "-0.0"  # a difference is no share
    assert METRICS["mpkpe"].text(0.0001) == "0"
    many = records().of_rows(torch.arange(4000) % 2)
    many.failed = torch.arange(4000) == 0
    assert "| mine | 99.9 / " in markdown([Score.of("mine", "single", [many])])


def test_what_was_not_measured_is_a_dash():
    nothing = float("nan")
    assert METRICS["mpkpe"].text(nothing) == "-"
    assert METRICS["mpjpe"].text(Estimate(nothing, nothing, nothing)) == "-"


def test_an_interval_whose_ends_nobody_knows_is_left_out():
    figure = report(records(), resamples=0)["tks"]
    assert METRICS["tks"].text(figure) == "75.0"


def test_a_score_is_of_a_table_or_of_one_for_each_seed():
    assert Score.of("mine", "long", records()).figures == Score.of("mine", "long", [records()]).figures
    assert len(Score.of("mine", "long", records()).records) == 1


def test_a_bar_in_a_name_is_no_cell_of_its_own():
    """Also where groups and disturbances are the columns."""
    scores = [Score.of("kick|run", "long", [records()])]
    groups = [GroupScore("kick|run", "long", "low|sport", 4, scores[0].figures)]
    study = Study(scores, groups={"family": groups}, curves=[CurvePoint("kick|run", "push", 0.5, Estimate(9, 8, 10))])
    tables = [text for text in f"{markdown(scores)}\n{study.markdown()}".split("\n\n") if text.startswith("|")]
    assert len(tables) == 4
    for text in tables:
        assert len({line.replace(r"\|", "").count("|") for line in text.splitlines()}) == 1, text
        assert r"kick\|run" in text
