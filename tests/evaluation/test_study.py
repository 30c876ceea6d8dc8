import csv
from functools import partial

import pytest

from plat.errors import ConfigError
from plat.evaluation import Entrant, EvaluationSetting, Score
from plat.evaluation.cells import Candidate, fingerprint
from plat.evaluation.disturbance import STRENGTHS, Disturbance, Strength
from plat.evaluation.study import StudyPlan, best_interfaces, run_study
from plat.evaluation.study_files import write_study
from plat.modules import PlainPolicy
from plat.motions import MotionLibrary
from plat.robots import G1
from tests.conftest import standing_clip
from tests.figures.scores import records
from tests.modules.policies.test_student import SMALL
from tests.recipes.runs import save_run


def test_every_test_of_a_plan(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "plat.evaluation.study.STRENGTHS", {**STRENGTHS, "friction": Strength("coefficient", (0.8, 0.1))}
    )
    run = save_run(tmp_path / "plain", PlainPolicy(G1, SMALL))
    candidate = Candidate("plain", partial(Entrant.of_run, run), fingerprint([b"plain"]))
    library = MotionLibrary.from_clips([standing_clip(name, frames=20) for name in "ab"])
    plan = StudyPlan(
        horizons=("short",),
        setting=EvaluationSetting(num_threads=1),
        rules=("supermimic",),
        families=["walk", "run"],
        difficulty=True,
        robustness=("friction",),
    )
    told: list[int] = []
    study = run_study(
        {candidate: candidate.load()}, library, plan, workers=1, told=lambda study: told.append(len(study.scores))
    )
    assert [score.horizon for score in study.scores] == ["short"]
    assert [(score.rule, score.count) for score in study.clips] == [("supermimic", 2)]
    assert {kind: sorted({one.group for one in found}) for kind, found in study.groups.items()} == {
        "family": ["run", "walk"],
        "family, supermimic": ["run", "walk"],
        "difficulty": ["calm"],
    }
    assert [(point.disturbance, point.strength) for point in study.curves] == [("friction", 0.8), ("friction", 0.1)]
    assert study.curves[0].tks == study.scores[0].figures["tks"]
    assert told == [1, 1, 1]
    write_study(study, tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "scores.csv",
        "whole_clips.csv",
        "groups.csv",
        "robustness.csv",
    }
    with (tmp_path / "out" / "whole_clips.csv").open(newline="") as file:
        assert {row["rule"] for row in csv.DictReader(file)} == {"supermimic"}
    text = study.markdown()
    for wanted in (
        *("**whole clips** at Short", "| supermimic | plain |"),
        *("**by family** at Short", "**robustness: friction** at Short"),
    ):
        assert wanted in text


def test_intervals_are_over_the_motions_that_clips_are_pieces_of(tmp_path):
    """Of three pieces of two motions, a horizon leaves the first one out."""
    run = save_run(tmp_path / "plain", PlainPolicy(G1, SMALL))
    candidate = Candidate("plain", partial(Entrant.of_run, run), fingerprint([b"plain"]))
    library = MotionLibrary.from_clips([standing_clip(name, frames=20) for name in ("a_0", "a_1", "b")])
    plan = StudyPlan(
        horizons=("short", "medium"),
        setting=EvaluationSetting(num_threads=1),
        rules=("supermimic",),
        families=["walk", "walk", "run"],
        sources=[5, 5, 7],
    )
    study = run_study(
        {candidate: candidate.load()},
        library,
        plan,
        workers=1,
        clips=lambda horizon: [0, 1, 2] if horizon == "short" else [1, 2],
    )
    sources = {}
    for score in study.scores:
        (records,) = score.records
        pairs = zip(records.clip.tolist(), records.source.tolist(), strict=True)
        sources[score.horizon] = sorted(set(pairs))
    assert sources == {"short": [(0, 5), (1, 5), (2, 7)], "medium": [(0, 5), (1, 7)]}
    assert {(one.group, one.count) for one in study.groups["family, supermimic"]} == {("walk", 2), ("run", 1)}


def test_curves_of_disturbed_robots_are_refused():
    disturbed = EvaluationSetting(disturbance=Disturbance(noise=0.5))
    assert StudyPlan(horizons=("short",), setting=disturbed).robustness == ()
    with pytest.raises(ConfigError, match="expected an undisturbed setting"):
        StudyPlan(horizons=("short",), setting=disturbed, robustness=("push",))


@pytest.mark.parametrize("test", [{"rules": ("humantracker",)}, {"authored": 2}])
def test_partial_keyframes_are_refused_by_tests_that_would_leave_them_out(test):
    hands = EvaluationSetting(partial="hands")
    assert StudyPlan(horizons=("short",), setting=hands).setting.partial == "hands"
    with pytest.raises(ConfigError, match="the setting's partial is 'hands', expected None"):
        StudyPlan(horizons=("short",), setting=hands, **test)


def test_the_best_interface_of_each_tracker():
    scores = [
        Score.of(name, "mixed", [records(failures, 0.1, error)])
        for name, failures, error in (
            ("PLAT", 0.1, 0.1),
            ("wbc, next-frame", 0.1, 0.4),
            ("wbc, line", 0.1, 0.2),
            ("wbc, cascade", 0.5, 0.1),
        )
    ]
    best = best_interfaces(scores, "mixed")
    assert best == {"PLAT": "PLAT", "wbc, line": "wbc (line)"}


def test_runs_with_a_comma_in_their_names_are_rows_of_their_own():
    names = ("PLAT, seed 1", "PLAT, seed 2", "wbc (unverified), line")
    scores = [Score.of(name, "mixed", [records(0.1, 0.1, 0.1)]) for name in names]
    shown = {name: name for name in names[:2]} | {names[2]: "wbc (unverified, line)"}
    assert best_interfaces(scores, "mixed") == shown


@pytest.mark.parametrize("name", ["plain, new", "plain (new)"])
def test_differences_to_a_row_whatever_its_name(tmp_path, name):
    runs = [save_run(tmp_path / one, PlainPolicy(G1, SMALL)) for one in (name, "other")]
    candidates = [Candidate(run.name, partial(Entrant.of_run, run), fingerprint([run.name.encode()])) for run in runs]
    library = MotionLibrary.from_clips([standing_clip(one, frames=20) for one in "ab"])
    plan = StudyPlan(horizons=("mixed",), setting=EvaluationSetting(num_threads=1), choose=True, ours=name)
    study = run_study({one: one.load() for one in candidates}, library, plan, workers=1)
    assert [(found.ours, found.policy) for found in study.differences] == [(name, "other")]
    assert not study.interfaces


def test_a_test_that_is_named_twice_is_run_once():
    plan = StudyPlan(
        horizons=("mixed", "distant", "mixed"),
        rules=("supermimic", "supermimic"),
        robustness=("push", "push"),
        longer=("distant",),
        families=("walk", "walk"),
    )
    assert (plan.horizons, plan.rules, plan.robustness) == (("mixed", "distant"), ("supermimic",), ("push",))
    assert plan.longer == ()
    assert plan.families == ("walk", "walk")


@pytest.mark.parametrize(("horizons", "expected"), [(("long", "mixed"), "mixed"), (("long", "short"), "long")])
def test_the_main_horizon(horizons, expected):
    assert StudyPlan(horizons=horizons).main_horizon == expected
