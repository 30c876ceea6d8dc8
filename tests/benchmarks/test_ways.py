import csv
import math
from dataclasses import astuple
from pathlib import Path

import pytest
import torch

import benchmarks.ways
from benchmarks.ways import Noise, Ways, WaysConfig, at_loss, follow, main, pieces, sweep, varied
from plat.envs import make_keyframe_env
from plat.errors import ConfigError, MotionError
from plat.modules import (
    FinetunedPolicy,
    LatentPolicy,
    LatentPolicyConfig,
    PlainPolicy,
    PlainPolicyConfig,
    RefinementConfig,
)
from plat.robots import G1
from plat.spec.timing import Timing

STEPS, COMMANDS, SAMPLES = 12, 3, 4


@pytest.fixture
def latent():
    torch.manual_seed(0)
    return LatentPolicy(G1, LatentPolicyConfig(backbone=(16,), hidden_size=8, prior=(8,), decoder=(16,)))


@pytest.fixture
def motions(library):
    return pieces(library, STEPS, COMMANDS, SAMPLES, seed=0)


@pytest.fixture
def observation(library):
    return make_keyframe_env(library, num_envs=SAMPLES).reset()


def test_noise_is_held_or_new_in_its_unit():
    loc, unit = torch.ones(500, 4), torch.full((500, 4), 3.0)
    held, new = Noise(0.5, held=True, seed=0), Noise(0.5, held=False, seed=0)
    assert torch.equal(held(loc), held(loc))
    assert not torch.equal(new(loc), new(loc))
    assert (held(loc, unit) - loc).std() == pytest.approx(1.5, rel=0.05)
    assert torch.equal(Noise(0.0, held=True, seed=0)(loc, unit), loc)


@pytest.mark.parametrize("space", ["latent", "action"])
def test_without_noise_a_policy_acts_as_deployed(latent, observation, space):
    expected = latent.deployed()(observation.clone())["action"]
    torch.testing.assert_close(
        varied(latent, space, Noise(0.0, held=True, seed=0))(observation.clone())["action"], expected
    )
    noisy = varied(latent, space, Noise(0.5, held=True, seed=0))(observation.clone())["action"]
    assert (noisy - expected).abs().mean() > 1e-3


@pytest.mark.parametrize("space", ["latent", "action"])
def test_a_fine_tuned_policy_acts_by_its_own_lead(latent, observation, space):
    policy = FinetunedPolicy(latent, RefinementConfig(lead=0.2))
    expected = policy.deployed()(observation.clone())["action"]
    assert not expected.equal(latent.deployed()(observation.clone())["action"])
    same = varied(policy, space, Noise(0.0, held=True, seed=0))(observation.clone())["action"]
    torch.testing.assert_close(same, expected)


def test_a_policy_without_a_latent_has_noise_on_its_action_alone(observation):
    plain = PlainPolicy(G1, PlainPolicyConfig(backbone=(16,), hidden_size=8, decoder=(16,)))
    expected = plain.deployed()(observation.clone())["action"]
    noisy = varied(plain, "action", Noise(0.1, held=True, seed=0))(observation.clone())["action"]
    assert float((noisy - expected).detach().std()) == pytest.approx(0.1, rel=0.3)
    with pytest.raises(ConfigError, match="PlainPolicy has no prior, expected a LatentPolicy"):
        varied(plain, "latent", Noise(0.1, held=True, seed=0))


def test_samples_of_a_command_begin_alike_and_commands_do_not(library, motions):
    assert motions.clip_length.tolist() == [STEPS + 1] * COMMANDS * SAMPLES
    first = motions.qpos(motions.clip_start).view(COMMANDS, SAMPLES, -1)
    assert torch.equal(first, first[:, :1].expand_as(first))
    assert not torch.equal(first[0], first[1])
    other = pieces(library, STEPS, COMMANDS, SAMPLES, seed=1)
    assert not torch.equal(other.qpos(other.clip_start), motions.qpos(motions.clip_start))
    with pytest.raises(MotionError, match="no motion has more than 100000 control steps"):
        pieces(library, 100_000, COMMANDS, SAMPLES, seed=0)


def test_ways_part_by_noise_alone(latent, motions):
    same, little, much = (
        follow(varied(latent, "action", Noise(scale, held=True, seed=0)), motions, SAMPLES)
        for scale in (0.0, 0.05, 0.2)
    )
    assert same.met > 0
    assert same.apart == same.at_arrival == 0
    assert 0 < little.apart < much.apart
    assert little.at_arrival > little.apart  # it adds up
    assert much.jerk > 0


@pytest.mark.parametrize("space", ["latent", "action"])
def test_a_policy_is_told_the_time_left_in_its_own_unit(motions, space):
    config = LatentPolicyConfig(backbone=(16,), hidden_size=8, prior=(8,), decoder=(16,), timing=Timing(max_steps=150))
    policy, told = varied(LatentPolicy(G1, config), space, Noise(0.0, held=True, seed=0)), []
    policy.register_forward_pre_hook(lambda _, given: told.append(given[0]["command", "horizon"].max()))
    follow(policy, motions, SAMPLES)
    assert float(told[0]) == pytest.approx(STEPS / 150)


def test_ways_where_nobody_arrives_have_no_distance(latent, motions):
    lost = follow(varied(latent, "action", Noise(100.0, held=False, seed=0)), motions, SAMPLES)
    assert lost.met == 0
    assert math.isnan(lost.apart)


def test_noise_doubles_until_too_many_are_lost(latent, motions, monkeypatch):
    met = iter((0.99, 0.95, 0.85, 0.1))
    monkeypatch.setattr(benchmarks.ways, "follow", lambda *_: Ways(next(met), 0.1, 0.1, 1.0))
    series = list(sweep(latent, "latent", True, motions, SAMPLES, seed=0, least=0.9))
    assert [(scale, ways.met) for scale, ways in series] == [(0.5, 0.99), (1.0, 0.95), (2.0, 0.85)]


def test_distance_at_equal_loss_lies_between_two_scales():
    series = [
        Ways(met, apart, 2 * apart, 1.0) for met, apart in ((0.98, 0.0), (0.99, 0.01), (0.97, 0.03), (0.93, 0.07))
    ]
    assert astuple(at_loss(series, 0.03)) == pytest.approx((0.95, 0.05, 0.1, 1.0))
    assert at_loss(series, 0.01).apart == pytest.approx(0.03)
    assert at_loss(series, 0.5) is None


def test_a_row_for_each_noise_and_a_value_for_each_seed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(benchmarks.ways, "DOUBLINGS", 1)
    table = tmp_path / "ways.csv"
    found = main(
        WaysConfig(
            runs=(Path("dagger-g1"), Path("imagined-g1")),
            motions="generated:val/walk@4",
            steps=STEPS,
            commands=2,
            samples=2,
            seeds=(0, 1),
            csv=table,
        )
    )
    assert len(found) == 4 + 2
    assert {len(values) for values in found.values()} == {2}
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * (1 + 4) + 2 * (1 + 2)
    none = [row for row in rows if row["noise"] == "none"]
    assert {row["apart_mm"] for row in none} == {"0.0"}
    assert {row["met_percent"] for row in none} == {"100.0"}
    assert "never lost" in capsys.readouterr().out
