from pathlib import Path

import pytest

from plat.runs import SavedRun, write_json
from plat.runs.lineage import made_by, parents, trained_on


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


def test_what_is_not_here_is_not_made_up(tmp_path):
    alone = run(tmp_path / "alone", "distill", expert="ex22", student="plain", motions=["a.npz"])
    assert made_by(alone) == "plat distill, plain"
    assert trained_on(alone) == ["a"]
    write_json(tmp_path / "bare" / "config.json", {"policy": {}})
    assert (made_by(SavedRun(tmp_path / "bare")), trained_on(SavedRun(tmp_path / "bare"))) == ("plat", [])


def test_shipped_weights_and_circles(tmp_path):
    assert made_by(run(tmp_path / "mine", "imagine", init="imagined-g1", student="plain")).endswith("from imagined-g1")
    assert "hard_nc" in trained_on(SavedRun(tmp_path / "mine"))
    run(tmp_path / "a", "expert", init="b", motions=["x.npz"])
    run(tmp_path / "b", "expert", init="a", motions=["y.npz"])
    assert trained_on(SavedRun(tmp_path / "a")) == ["x", "y"]
