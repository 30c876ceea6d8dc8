import pytest

from plat.errors import RecordsError
from plat.evaluation import CLIP_METRICS, Estimate
from plat.evaluation.groups import GroupScore
from plat.evaluation.score_table import difference_table, overview, paired
from plat.evaluation.study import ClipScore, CurvePoint, Study, clip_table
from plat.evaluation.study_files import read_study, write_study
from tests.figures.scores import made_up

FIGURE = Estimate(0.012345678, 0.25, float("nan"))


def test_what_was_written_is_read(tmp_path):
    scores = made_up("PLAT", "wbc (line)")
    study = Study(
        scores=scores,
        clips=[ClipScore("PLAT", "supermimic", 8, dict.fromkeys(CLIP_METRICS, FIGURE))],
        dense=scores[1:2],
        dense_clips=[ClipScore("wbc", "humantracker", 8, dict.fromkeys(CLIP_METRICS, Estimate(75.0, 50.0, 90.0)))],
        groups={
            "family": [GroupScore("PLAT", "mixed", "walk, fast", 3, {"tks": FIGURE, "mpjpe": FIGURE})],
            "authored": [GroupScore("PLAT", "authored", "hold", 2, {"reached": FIGURE})],
        },
        curves=[CurvePoint("PLAT", "push", 0.5, FIGURE)],
        interfaces=scores[:1],
        differences=paired(scores, "PLAT"),
    )
    write_study(study, tmp_path)
    read = read_study(tmp_path)
    assert overview(read.scores) == overview(scores)
    assert overview(read.interfaces) == overview(scores[:1])
    assert difference_table(read.differences) == difference_table(study.differences)
    assert overview(read.dense) == overview(scores[1:2])
    assert clip_table(read.clips) == clip_table(study.clips)
    assert clip_table(read.dense_clips) == clip_table(study.dense_clips)
    assert "| humantracker | wbc | 2 of 8 | 75.0 (50.0-90.0) |" in clip_table(read.dense_clips)
    assert read.curve_table("push") == study.curve_table("push")
    (family,) = read.groups["family"]
    assert (family.group, family.count, list(family.figures)) == ("walk, fast", 3, ["tks", "mpjpe"])
    assert family.figures["tks"].value == pytest.approx(FIGURE.value, rel=1e-5)
    assert read.groups["authored"][0].test == "authored"


def test_results_of_an_earlier_plan_do_not_stay(tmp_path):
    scores = made_up("PLAT")
    curves = [CurvePoint("PLAT", "push", 0.5, FIGURE)]
    write_study(Study(scores=scores, interfaces=scores, dense=scores, curves=curves), tmp_path)
    assert len(list(tmp_path.iterdir())) == 4
    write_study(Study(), tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert read_study(tmp_path) == Study()


def test_another_table_is_refused(tmp_path):
    (tmp_path / "scores.csv").write_text("name,size\na,1\n")
    with pytest.raises(RecordsError, match=r"scores.csv': not a table of a study"):
        read_study(tmp_path)


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("scores.csv", "run,long,tks," + "9x" * 4000 + ",1,1"),
        ("groups.csv", "family,walk,three,run,mixed,tks,1,1,1"),
        ("robustness.csv", "gravity,1,g,run,tks,1,1,1"),
        ("robustness.csv", "push,much,m/s,run,tks,1,1,1"),
        ("robustness.csv", "push,1,m/s,run,mpjpe,1,1,1"),
    ],
)
def test_spoilt_tables_are_refused_in_one_short_line(tmp_path, name, line):
    heads = {
        "scores.csv": "policy,horizon",
        "groups.csv": "grouping,group,count,policy,test",
        "robustness.csv": "disturbance,strength,unit,policy",
    }
    (tmp_path / name).write_text(f"{heads[name]},metric,value,low,high\n{line}\n")
    with pytest.raises(RecordsError) as caught:
        read_study(tmp_path)
    assert len(str(caught.value).replace(str(tmp_path), "")) < 200
