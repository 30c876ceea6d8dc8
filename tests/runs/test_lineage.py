from pathlib import Path

import pytest

from plat.modules import FinetunedPolicy, LatentPolicy, PlainPolicy
from plat.robots import G1
from plat.runs import SavedRun, write_json
from plat.runs.inputs import weights_print
from plat.runs.lineage import made_by, parents, trained_on
from tests.modules.policies.test_student import SMALL
from tests.recipes.runs import save_run


def run(folder: Path, recipe: str, **settings) -> SavedRun:
    write_json(folder / "config.json", {"policy": {}, "recipe": {"name": recipe, "settings": settings}})
    return SavedRun(folder)


@pytest.fixture
def refined(tmp_path) -> SavedRun:
    """A policy that was refined, from one that was distilled, from an expert on another's data."""
    run(tmp_path / "expert", "expert", motions=["/data/walks_train.npz", "generated:train@60"])
    run(tmp_path / "dagger", "distill", expert="runs/expert", student="latent", motions=["walks_train.npz"])
    task = {"authored": 0.5}
    return run(tmp_path / "plat", "refine", student="dagger", variant="action", motions=["fights.csv"], task=task)


def test_runs_beside_it_are_followed(refined):
    assert [parent.name for parent in parents(refined)] == ["dagger"]
    assert made_by(refined) == "plat refine, action, from dagger"
    assert made_by(parents(refined)[0]) == "plat distill, latent, from expert"
    assert trained_on(refined) == ["fights", "authored keyframes", "walks", "generated"]


def test_runs_of_a_name_are_told_apart_by_their_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for group in ("small", "large"):
        run(tmp_path / group / "expert", "expert", motions=[f"{group}.npz"])
    student = run(tmp_path / "small" / "dagger", "distill", expert="large/expert", motions=["own.npz"])
    assert trained_on(student) == ["own", "large"]
    bare = run(tmp_path / "small" / "other", "distill", expert="expert", motions=["own.npz"])
    assert trained_on(bare) == ["own", "small"]


@pytest.fixture
def policies(tmp_path, monkeypatch) -> dict[str, PlainPolicy]:
    """Policies of the runs ``old/start`` and ``start``, in the working directory."""
    monkeypatch.chdir(tmp_path)
    made = {name: PlainPolicy(G1, SMALL) for name in ("old/start", "start")}
    for name, policy in made.items():
        save_run(tmp_path / name, policy)
    return made


@pytest.mark.parametrize("name", ["old/start", "start", "elsewhere/start"])
def test_a_run_is_known_by_its_weights(tmp_path, policies, name):
    for folder, policy in policies.items():
        child = run(tmp_path / "old" / "child", "imagine", init=name)
        write_json(child.folder / "inputs.json", {"init": weights_print(policy)})
        wanted = tmp_path / folder
        # under another name than its own, the one beside is found
        found = [parent.folder.resolve() for parent in parents(child)]
        assert found == ([wanted] if folder in (name, "old/start") else [])
    write_json(child.folder / "inputs.json", {"init": "of weights that are gone"})
    assert parents(child) == []


def test_a_student_is_known_within_the_policy_that_was_fine_tuned(tmp_path):
    tuned = FinetunedPolicy(LatentPolicy(G1, SMALL))
    save_run(tmp_path / "tuned", tuned)
    child = run(tmp_path / "child", "refine", student="tuned")
    write_json(child.folder / "inputs.json", {"student": weights_print(tuned.student)})
    assert [parent.name for parent in parents(child)] == ["tuned"]


@pytest.mark.parametrize("name", ["student", "init"])
def test_a_student_that_was_refined_by_imagination_is_known(tmp_path, name):
    student, other = (LatentPolicy(G1, SMALL) for _ in range(2))
    save_run(tmp_path / "student", student)
    child = run(tmp_path / "child", "refine-model", student="student")
    for policy, found in ((student, ["student"]), (other, [])):
        write_json(child.folder / "inputs.json", {name: weights_print(policy)})  # init: of an older plat
        assert [parent.name for parent in parents(child)] == found


def test_a_run_that_was_trained_on_since_is_not_that_of_the_average(tmp_path):
    part = {"run": "a", "finished": {"steps": 5}, "made_with": None}
    write_json(tmp_path / "mean" / "config.json", {"average": [part]})
    for steps, found in ((5, ["a"]), (6, [])):
        write_json(tmp_path / "a" / "config.json", {"finished": {"steps": steps}})
        assert [parent.name for parent in parents(SavedRun(tmp_path / "mean"))] == found


def test_what_is_not_here_is_not_made_up(tmp_path):
    alone = run(tmp_path / "alone", "distill", expert="ex22", student="plain", motions=["a.npz"])
    assert made_by(alone) == "plat distill, plain"
    assert trained_on(alone) == ["a"]
    assert trained_on(run(tmp_path / "own", "expert", motions=["generated_by_me.npz"])) == ["generated_by_me"]
    write_json(tmp_path / "bare" / "config.json", {"policy": {}})
    assert (made_by(SavedRun(tmp_path / "bare")), trained_on(SavedRun(tmp_path / "bare"))) == ("plat", [])


def test_shipped_weights_and_circles(tmp_path):
    assert made_by(run(tmp_path / "mine", "imagine", init="imagined-g1", student="plain")).endswith("from imagined-g1")
    assert "hard_nc" in trained_on(SavedRun(tmp_path / "mine"))
    run(tmp_path / "a", "expert", init="b", motions=["x.npz"])
    run(tmp_path / "b", "expert", init="a", motions=["y.npz"])
    assert trained_on(SavedRun(tmp_path / "a")) == ["x", "y"]
