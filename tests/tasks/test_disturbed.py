import pytest
import torch
from tensordict import TensorDict

from plat.collectors import RolloutReplay
from plat.envs.randomized_physics import num_physics
from plat.envs.transforms import NoiseLevels, RandomizationRanges
from plat.errors import ConfigError
from plat.modules import DynamicsConfig, DynamicsModel, PlainPolicy
from plat.objectives import DynamicsLoss, ImaginationLoss
from plat.robots import G1
from plat.tasks import SimulatedTask, TimedKeyframes, TimedKeyframesConfig
from plat.tasks.disturbed import applied_action, measuring

RANGES = RandomizationRanges(push_interval=(0.1, 0.2), control_delay=0.5)


@pytest.fixture(scope="module")
def task(library):
    return TimedKeyframes(library, TimedKeyframesConfig(chains=6))


@pytest.fixture(scope="module")
def rollout(task):
    torch.manual_seed(0)
    env = SimulatedTask(task, 6, randomization=RANGES)
    out = env.rollout(24, lambda td: td.set("action", 0.2 * torch.randn(6, 29)), break_when_any_done=False)
    return env, out


def test_a_delayed_robot_gets_its_last_action():
    memory = TensorDict({"last_action": torch.zeros(2, 3), "delayed": torch.tensor([True, False])}, [2])
    assert applied_action(memory, torch.ones(2, 3)).tolist() == [[0, 0, 0], [1, 1, 1]]
    assert applied_action(memory.exclude("delayed"), torch.ones(2, 3)).equal(torch.ones(2, 3))


def test_the_simulations_have_what_the_model_is_told(task):
    env = SimulatedTask(task, 4, randomization=RANGES)
    physics = env.reset()["memory", "physics"]
    kp = torch.from_numpy(env.physics.model.actuator_gainprm[:, 0].copy())
    factors = env.physics.model_field("actuator_gainprm")[:, :, 0] / kp
    torch.testing.assert_close(factors.float(), 1 + RANGES.motor_gain * physics[:, 4:33])
    low, high = RANGES.foot_friction
    foot = env.physics.model.body(G1.feet[0]).id
    geom = next(
        i
        for i in range(env.physics.model.ngeom)
        if env.physics.model.geom_bodyid[i] == foot and env.physics.model.geom_contype[i]
    )
    friction = env.physics.model_field("geom_friction")[:, geom, 0].float()
    torch.testing.assert_close(friction, 0.5 * (low + high) + 0.5 * (high - low) * physics[:, 0])


def test_encoders_are_biased_for_the_policy_alone(task, rollout):
    _, out = rollout
    row = out[0, 5]
    bias = row["memory", "encoder_bias"]
    assert bias.abs().max() > 0.001
    true = row["robot_state"][7:36] - G1.default_joint_pos
    torch.testing.assert_close(row["robot", "joint_pos"], true + bias)


def test_physics_lasts_for_an_episode(rollout):
    _, out = rollout
    same = (out["memory", "physics"][:, 1:] == out["memory", "physics"][:, :-1]).all(-1)
    assert same.equal(~out["next", "done"][:, :-1, 0])


def test_pushes_are_told_and_no_window_leads_over_one(rollout):
    env, out = rollout
    pushed = out["next", "pushed"]
    assert 6 * 24 / 10 * 0.5 < pushed.sum() < 6 * 24 / 5 * 1.5
    jump = (out["next", "robot_state"][..., 36:39] - out["robot_state"][..., 36:39]).norm(dim=-1)
    assert jump[pushed].mean() > 2 * jump[~pushed].mean()
    replay = RolloutReplay(6, 24, ["robot_state", "memory", "action"])
    replay.extend(out)
    windows = replay.windows(200, 4)
    speeds = windows["robot_state"][..., 36:39]
    assert speeds.diff(dim=1).norm(dim=-1).max() < jump[pushed].max()
    assert set(env.state_dict()["_extra_state"]) >= {"physics", "steps_to_push"}


def test_model_and_imagination_know_the_robot_that_they_imagine(task, rollout):
    _, out = rollout
    torch.manual_seed(0)
    model = DynamicsModel(G1, DynamicsConfig(hidden=(32,)), num_parameters=num_physics(G1))
    replay = RolloutReplay(6, 24, ["robot_state", "memory", "action"])
    replay.extend(out)
    windows, states = replay.windows(16, 4), replay.states(16)
    policy = PlainPolicy(G1).deployed()

    def losses():
        with torch.random.fork_rng():
            torch.manual_seed(1)
            dynamics = DynamicsLoss(model)(windows)["loss_dynamics"]
            imagined = ImaginationLoss(policy, model, task, steps=3)(states)["loss_policy"]
        return float(dynamics.detach()), float(imagined.detach())

    before = losses()
    for entries in (windows, states):
        entries["memory", "physics"] = -entries["memory", "physics"]
    after = losses()
    assert before[0] != after[0]
    assert before[1] != after[1]


def test_a_model_goes_on_from_one_that_was_told_less():
    torch.manual_seed(0)
    trained = DynamicsModel(G1, DynamicsConfig(hidden=(32,)))
    model = DynamicsModel(G1, DynamicsConfig(hidden=(32,)), num_parameters=62)
    model.take_over(trained)
    state, _ = torch.randn(5, 71), None
    from plat.envs import GeneralizedState

    states, target = GeneralizedState.unpack(state), torch.randn(5, 29)
    told = model(states, target, torch.randn(5, 62)).pack()
    torch.testing.assert_close(told, trained(states, target).pack())
    with pytest.raises(ConfigError, match="62 parameters"):
        trained.take_over(model)


def test_noise_is_on_what_is_measured():
    policy = PlainPolicy(G1).deployed()
    noisy = measuring(policy, NoiseLevels())
    seen = TensorDict(
        {
            key: torch.zeros(3, width)
            for key, width in (
                (("robot", "joint_pos"), 29),
                (("robot", "joint_vel"), 29),
                (("robot", "root_ang_vel_b"), 3),
                (("robot", "root_lin_vel_b"), 3),
                (("robot", "gravity_b"), 3),
                (("robot", "last_action"), 29),
                (("goal", "joint_pos"), 29),
                (("goal", "root_pos_b"), 3),
                (("goal", "root_rot6d_b"), 6),
                (("goal", "keypoint_pos_b"), 42),
                (("command", "horizon"), 1),
            )
        },
        [3],
    )
    assert not noisy(seen.clone())["action"].equal(policy(seen.clone())["action"])
    silent = measuring(policy, NoiseLevels().scaled(0.0))
    assert silent(seen.clone())["action"].equal(policy(seen.clone())["action"])


def test_strength_zero_is_the_nominal_robot():
    ranges = RandomizationRanges().scaled(0.0)
    assert ranges.foot_friction == (1.0, 1.0)
    assert ranges.motor_gain == ranges.control_delay == ranges.encoder_bias == 0
    assert RandomizationRanges().scaled(1.0) == RandomizationRanges()
