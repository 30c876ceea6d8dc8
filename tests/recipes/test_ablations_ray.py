"""The ablation on a Ray cluster of two CPUs on this machine."""

import dataclasses

import pytest

from plat.cli import evaluate
from plat.modules import Expert, ExpertConfig, LatentPolicy
from plat.recipes import ablations
from plat.robots import G1
from tests.modules.policies.test_student import SMALL
from tests.on_ray import local_cluster
from tests.recipes.runs import save_run, write_motions

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'plat-rl[ray]'")
pytest.importorskip("matplotlib")
pytestmark = pytest.mark.slow


def test_a_cluster_scores_the_same(tmp_path, monkeypatch, capsys):
    save_run(tmp_path / "runs" / "expert", Expert(G1, ExpertConfig(hidden=(8,))), steps=100)
    save_run(tmp_path / "runs" / "dagger", LatentPolicy(G1, SMALL))
    for name in ("draw_scores", "draw_strips"):  # their own tests draw them
        monkeypatch.setattr(evaluate, name, lambda folder, *_, name=name: [folder / f"{name}.png"])
    recipe = ablations.AblationsRecipe(
        runs=tmp_path / "runs",
        motions=(write_motions(tmp_path, frames=21),),
        out=tmp_path / "out",
        horizon=("long", "mixed"),
        device="cpu",
    )
    alone = ablations.main(dataclasses.replace(recipe, out=tmp_path / "alone"))
    on_two = dataclasses.replace(recipe, ray=True, training=dataclasses.replace(recipe.training, cpus=1))
    with local_cluster(ray):
        splits = ablations.main(on_two)
    assert {name: [score.figures for score in scores] for name, scores in splits.items()} == {
        name: [score.figures for score in scores] for name, scores in alone.items()
    }
    assert {path.name for path in (tmp_path / "out" / "logs").iterdir()} == {"expert.txt", "dagger.txt"}
    assert "0 trainings and 2 evaluations" in capsys.readouterr().out
