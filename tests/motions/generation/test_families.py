from importlib import resources

import numpy as np
import pytest

from plat.motions.generation.families import FAMILIES, NOT_FOLLOWED, WIDE_FAMILIES
from plat.motions.generation.script import MotionScript

STANCE = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])


def written(family: str, seed: int) -> MotionScript:
    script = MotionScript(STANCE, {"left_elbow": 0.7, "right_elbow": 0.7})
    {**FAMILIES, **WIDE_FAMILIES}[family](script, np.random.default_rng(seed))
    script.wait(0.1)
    return script


@pytest.mark.parametrize("family", [*FAMILIES, *WIDE_FAMILIES])
@pytest.mark.parametrize("seed", range(3))
def test_phrases_end_as_they_began(family, seed):
    script = written(family, seed)
    draft = script.draft(0.02)
    for name, values in draft.channels.items():
        assert values[-1] == pytest.approx(script.home.get(name, 0.0), abs=1e-6), name
    # flat feet side by side, the weight between them
    np.testing.assert_allclose(draft.foot_pos[-1, :, 2], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(script.feet[0, :2] - script.feet[1, :2]), 0.2, atol=1e-6)
    np.testing.assert_allclose(draft.zmp[-1], script.under(0.5), atol=1e-9)


@pytest.mark.parametrize("family", [*FAMILIES, *WIDE_FAMILIES])
def test_every_seed_is_another_motion(family):
    assert written(family, 0).now != written(family, 1).now


def traveled(family: str, seed: int) -> np.ndarray:
    """Where the middle of the feet went ``[2]`` (m) and how far they turned (rad)."""
    feet = written(family, seed).feet
    return np.array([*feet[:, :2].mean(0), feet[:, 2].mean()])


@pytest.mark.parametrize("seed", range(5))
def test_walks_go_their_way(seed):
    assert traveled("walk", seed)[:2] @ [1, 0] > 0.3
    assert traveled("backward", seed)[0] < -0.3
    assert abs(traveled("sideways", seed)[1]) > 0.15
    assert abs(traveled("turn", seed)[2]) > 0.5
    np.testing.assert_allclose(traveled("turn", seed)[:2], 0, atol=1e-9)
    np.testing.assert_allclose(traveled("step", seed), 0, atol=1e-9)


def test_walking_speeds_span_the_range():
    speeds = []
    for seed in range(60):
        draft = written("walk", seed).draft(0.02)
        x = draft.foot_pos[..., :2].mean(1)
        # over the middle third, away from setting off and coming to rest
        first, last = len(x) * 2 // 5, len(x) * 3 // 5
        speeds.append(np.linalg.norm(x[last] - x[first]) / ((last - first) * 0.02))
    assert min(speeds) < 0.3
    assert max(speeds) > 0.85


def test_families_that_experts_cannot_follow_are_families():
    for expert, families in NOT_FOLLOWED.items():
        assert set(families) <= {*FAMILIES, *WIDE_FAMILIES}, expert
    weights = [path.name for path in resources.files("plat.weights").iterdir()]
    assert set(NOT_FOLLOWED) == {f"{name}-g1" for name in weights if name.startswith("expert")}
