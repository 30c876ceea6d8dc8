"""The search with Ray Tune finds settings of a tiny recipe."""

import dataclasses

import pytest

from examples.search import RECIPE, search
from plat.objectives import PPOConfig
from tests.on_ray import local_cluster

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'plat-rl[ray]'")
pytest.importorskip("ray.tune", reason="Ray Tune is not installed: pip install 'ray[tune]'", exc_type=ImportError)
pytestmark = pytest.mark.slow


def test_it_returns_one_of_its_samples(tmp_path):
    recipe = dataclasses.replace(
        RECIPE,
        motions=("generated:val@8",),
        minutes=None,
        steps=100,
        num_envs=2,
        out=tmp_path / "search",
        policy=dataclasses.replace(RECIPE.policy, hidden=(8,)),
        critic=(8,),
        ppo=dataclasses.replace(PPOConfig(), minibatches=1),
        device="cpu",
    )
    with local_cluster(ray):
        best = search(recipe, samples=2, cpus=1)
    assert 1e-4 <= best["ppo.lr"] <= 1e-3
    runs = list((tmp_path / "search").glob("*/metrics.csv"))
    assert len(runs) == 2
    assert any(f"lr={best['ppo.lr']}"[:12] in path.parent.name for path in runs)
