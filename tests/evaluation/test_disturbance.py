from dataclasses import replace

import pytest
import torch
from torchrl.envs import Compose, TransformedEnv

from plat.envs import MotionTrackingEnv
from plat.envs.transforms import FirstFrames, Horizon
from plat.errors import ConfigError
from plat.evaluation import Disturbance, evaluate
from plat.evaluation.clip_draws import ClipSeeds
from plat.evaluation.disturbance import (
    STRENGTHS,
    Disturbed,
    disturbing,
    is_undisturbed,
    loaded_physics,
    observing_noise,
)
from plat.motions import MotionLibrary
from plat.robots import G1
from plat.spec.observation import OBSERVATION, ObservationTable, observing
from tests.conftest import standing_clip
from tests.evaluation.puppet import still


@pytest.fixture(scope="module")
def clips() -> MotionLibrary:
    return MotionLibrary.from_clips([standing_clip("a"), standing_clip("b")])


def disturbed(library: MotionLibrary, **strength) -> TransformedEnv:
    disturbance, seeds = Disturbance(**strength), ClipSeeds(0, range(2))
    env = MotionTrackingEnv(library, 2, num_threads=1, physics=loaded_physics(G1, disturbance))
    noise = observing_noise(library, disturbance, seeds)
    return TransformedEnv(env, Compose(*disturbing(env, None, disturbance, seeds), FirstFrames(library), *noise))


def rollout(env: TransformedEnv, actions: list[float]):
    current = env.reset()
    for value in actions:
        current["action"] = torch.full((2, 29), value)
        after = env.step(current)["next"]
        yield after
        current = after.clone()


def test_latency_delays_targets_by_control_steps(clips):
    """The joint that moves tells when a target has arrived."""

    def moved(latency: int) -> list[float]:
        env = disturbed(clips, latency=latency)
        torques = [float(after["state", "joint_torque"][0, 15].abs()) for after in rollout(env, [0.0] * 3 + [3.0] * 4)]
        env.close()
        return torques

    at_once, late = moved(0), moved(2)
    assert max(at_once[:3]) < 2.0 < at_once[3]
    assert max(late[:5]) < 2.0 < late[5]


def test_the_observed_last_action_is_that_of_the_policy(clips):
    env = disturbed(clips, latency=3)
    for value, after in zip([0.1, 0.2, 0.3], rollout(env, [0.1, 0.2, 0.3]), strict=True):
        assert float(after["robot", "last_action"][0, 0]) == pytest.approx(value)
    env.close()


def test_the_observed_last_action_is_scaled_as_the_table_says(clips):
    robot = [
        replace(entry, scale=0.5 if entry.name == "last_action" else 1.0) for entry in OBSERVATION.entries("robot")
    ]
    with observing(ObservationTable({**OBSERVATION.groups, "robot": tuple(robot)})):
        for latency in (0, 1):
            env = disturbed(clips, latency=latency)
            (after,) = rollout(env, [0.4])
            assert float(after["robot", "last_action"][0, 0]) == pytest.approx(0.2)
            assert float(env.base_env._last_action[0, 0]) == pytest.approx(0.0 if latency else 0.4)
            env.close()


def test_before_a_late_target_motors_hold_the_start(clips):
    env = disturbed(clips, latency=5)
    start = env.reset()["state", "joint_pos"]
    (first,) = rollout(env, [5.0])
    assert (first["state", "joint_pos"] - start).abs().max() < 0.05
    env.close()


def test_payload_friction_and_gains_change_the_physics(clips):
    env = disturbed(clips, payload=4.0, friction=0.2, motors=0.3)
    env.reset()
    physics = env.base_env.physics
    anchor = physics.model.body(G1.anchor).id
    assert physics.model.body_mass[anchor] == pytest.approx(G1.model().body_mass[anchor] + 4.0)
    assert physics.model.body_subtreemass[1] == pytest.approx(33.341 + 4.0, abs=0.01)
    feet = [g for g in range(physics.model.ngeom) if physics.model.geom_bodyid[g] in physics._ids_of(G1.feet)]
    sliding = physics.model_field("geom_friction")[:, feet, 0]
    assert (sliding[:, [physics.model.geom_contype[g] > 0 for g in feet]] == 0.2).all()
    gain = physics.model_field("actuator_gainprm")[:, :, 0] / G1.stiffness
    assert 0.6 < gain.min() < 0.9 < 1.1 < gain.max() < 1.4
    env.close()


def test_noise_is_on_what_is_measured_alone(clips):
    env = disturbed(clips, noise=2.0)
    (first,) = rollout(env, [0.0])
    true = first["state", "joint_pos"] - G1.default_joint_pos
    error = (first["robot", "joint_pos"] - true).abs()
    assert 0.005 < error.max() <= 0.02 + 1e-6
    env.close()


def test_pushes_have_their_strength(clips, monkeypatch):
    pushes: list[torch.Tensor] = []
    env = disturbed(clips, push=0.7)
    monkeypatch.setattr(env.base_env.physics, "push", lambda ids, velocity: pushes.append(velocity))
    list(rollout(env, [0.0] * 95))
    assert pushes
    assert all(
        float(one.norm()) == pytest.approx(0.7) and float(one[2:].abs().max()) == 0 for push in pushes for one in push
    )
    env.close()


def test_evaluation_takes_a_disturbance(clips):
    def error(disturbance: Disturbance | None) -> float:
        return float(evaluate(still, clips, Horizon(20, 20), disturbance=disturbance).window["joint_error"].nansum())

    assert error(Disturbance()) == error(None)
    assert error(Disturbance(payload=10.0)) != error(None)


@pytest.mark.parametrize("name", STRENGTHS)
def test_curves_begin_with_the_undisturbed_robot(name):
    strength = STRENGTHS[name]
    first, *others = (strength.disturbance(name, value) for value in strength.values)
    assert first == (Disturbance(friction=0.8) if name == "friction" else None)
    assert [is_undisturbed(name, value, G1) for value in strength.values] == [True] + [False] * len(others)
    fields = {getattr(one, name) for one in others}
    assert len(fields) == len(others)
    assert not {getattr(Disturbance(), name)} & fields


def test_the_first_friction_is_that_of_the_description():
    model = G1.model()
    soles = [
        g for g in range(model.ngeom) if model.geom_contype[g] and model.body(model.geom_bodyid[g]).name in G1.feet
    ]
    assert {round(float(model.geom_friction[g, 0]), 6) for g in soles} == {STRENGTHS["friction"].values[0]}


def test_nothing_is_added_without_a_disturbance(clips):
    env = MotionTrackingEnv(clips, 1, num_threads=1)
    seeds = ClipSeeds(0, range(2))
    assert list(disturbing(env, None, None, seeds)) == [] == observing_noise(clips, None, seeds)
    assert isinstance(disturbing(env, None, Disturbance(), seeds)[0], Disturbed)
    env.close()


@pytest.mark.parametrize("latency", [2.0, 1.5, -1])
def test_latency_is_a_whole_number_of_control_steps(latency):
    expected = f"Disturbance: latency is {latency}, expected a whole number of at least 0"
    with pytest.raises(ConfigError, match=expected):  # 2.0 ended in a TypeError as robots were made
        Disturbance(latency=latency)


@pytest.mark.parametrize("motors", [1.0, -0.1])
def test_motors_keep_a_stiffness_above_zero(motors):
    with pytest.raises(ConfigError, match=f"motors is {motors}, expected a number from 0 to 0.99"):
        Disturbance(motors=motors)
