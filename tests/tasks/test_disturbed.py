from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule

from plat.collectors import RolloutReplay
from plat.envs import GeneralizedState
from plat.envs.randomized_physics import num_physics
from plat.envs.transforms import NoiseLevels, RandomizationRanges
from plat.envs.transforms.settings import ROBOT_RANGES
from plat.modules import DynamicsConfig, DynamicsModel, PlainPolicy
from plat.objectives import DynamicsLoss, ImaginationLoss
from plat.robots import G1
from plat.spec.observation import OBSERVATION, ObservationTable, observing
from plat.tasks import SimulatedTask, TimedKeyframes, TimedKeyframesConfig, robot_entries
from plat.tasks.disturbed import advanced, estimated, measuring, motor_target, shown, told_to_model

RANGES = replace(ROBOT_RANGES, push_interval=(0.1, 0.2))


@pytest.fixture(scope="module")
def task(library):
    return TimedKeyframes(library, TimedKeyframesConfig(chains=6))


@pytest.fixture(scope="module")
def rollout(task):
    torch.manual_seed(0)
    env = SimulatedTask(task, 6, randomization=RANGES)
    out = env.rollout(24, lambda td: td.set("action", 0.2 * torch.randn(6, 29)), break_when_any_done=False)
    return env, out


def test_motors_follow_late_actions_by_biased_encoders(task):
    actions = [torch.full((3, 29), float(value)) for value in range(4)]
    memory = TensorDict({"last_action": actions[0], "earlier_action": actions[0], "delay": torch.arange(3)}, [3])
    memory["encoder_bias"] = torch.full((3, 29), 0.01)
    state, started = task.start(3)
    memory = started.update(memory)
    for given in (1, 2, 3):
        target = motor_target(G1, memory, actions[given])
        arrived = (target + 0.01 - G1.default_joint_pos) / G1.action_scale
        expected = torch.tensor([given, given - 1, max(given - 2, 0)]).float()
        torch.testing.assert_close(arrived, expected[:, None].expand(-1, 29), atol=1e-5, rtol=0)
        memory = advanced(task, memory, actions[given], state)
    nominal = memory.select("last_action")
    torch.testing.assert_close(
        motor_target(G1, nominal, actions[1]), G1.default_joint_pos + G1.action_scale.expand(3, -1)
    )
    after = advanced(task, task.start(3)[1], actions[1], state)
    assert {"earlier_action", "drift"}.isdisjoint(after.keys())


def test_the_simulations_have_what_the_model_is_told(task):
    env = SimulatedTask(task, 4, randomization=RANGES)
    physics = env.reset()["memory", "physics"]
    kp = torch.from_numpy(env.physics.model.actuator_gainprm[:, 0].copy())
    factors = env.physics.model_field("actuator_gainprm")[:, :, 0] / kp
    torso = env.physics.model.body(G1.anchor).id
    load = env.physics.model_field("body_mass")[:, torso] - env.physics.model.body_mass[torso]
    torch.testing.assert_close(load.float(), RANGES.torso_mass * physics[:, -1])
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


def test_sensors_are_biased_for_the_policy_alone(task, rollout):
    _, out = rollout
    row = out[0, 5]
    state = GeneralizedState.unpack(row["robot_state"])
    true = robot_entries(state, row["memory", "last_action"], G1)
    for bias, entry in (
        ("encoder_bias", "joint_pos"),
        ("gyro_bias", "root_ang_vel_b"),
        ("velocity_bias", "root_lin_vel_b"),
    ):
        assert row["memory", bias].abs().max() > 0.001
        torch.testing.assert_close(row["robot", entry], true[entry] + row["memory", bias])
    torch.testing.assert_close(row["robot", "gravity_b"], true["gravity_b"])


def test_imagined_robots_drift_see_and_pay_as_simulated_ones_do(library):
    """From the same states and actions, at the tenfold of what an estimator drifts."""
    torch.manual_seed(0)
    ranges = replace(RANGES, position_drift=0.4, heading_drift=0.3, height_error=0.1, push_interval=(10.0, 10.0))
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6, authored=0.5, partial=0.5))
    env = SimulatedTask(task, 8, randomization=ranges)
    before, compared = env.reset(), 0
    assert before["memory", "drift"][:, 2].abs().max() > 0.05
    for _ in range(12):
        before["action"] = 0.2 * torch.randn(8, 29)
        before, following = env.step_and_maybe_reset(before)
        after, going_on = before["next"], ~before["next", "done"][:, 0]
        state = GeneralizedState.unpack(after["robot_state"])
        memory = advanced(task, before["memory"], before["action"], state)
        here = estimated(state, memory)
        torch.testing.assert_close(-after["reward"][:, 0], task.cost(here, memory), atol=1e-5, rtol=1e-5)
        assert after["terminated"][:, 0].equal(task.failed(here, memory))
        # a new command is a draw; what is kept is the drift
        torch.testing.assert_close(after["memory", "drift"], memory["drift"], atol=1e-5, rtol=0)
        for key, value in shown(task, state, after["memory"]).items(True, True):
            torch.testing.assert_close(value[going_on], after[key][going_on], atol=1e-5, rtol=1e-5)
        from_the_truth = task.observe(state, after["memory"])["goal", "keypoint_pos_b"]
        assert (from_the_truth - after["goal", "keypoint_pos_b"]).abs().max() > 0.02
        compared += int(going_on.sum())
        before = following
    assert compared > 50
    moved = (before["memory", "drift"][:, :2]).norm(dim=-1)
    assert moved.max() > 0.01


def test_imagination_pays_in_the_world_of_the_estimate(task, rollout):
    """An offset of the estimate is an offset of the robot: the imagined costs are the same."""
    _, out = rollout
    states = out[:, 5].select("robot_state", "memory")
    states["memory", "drift_rate"] = torch.zeros_like(states["memory", "drift_rate"])
    model = DynamicsModel(G1, DynamicsConfig(hidden=(32,)), num_parameters=num_physics(G1))
    costs = []
    for offset, moved in ((0.05, 0.0), (0.0, 0.05)):
        start = states.clone()
        start["memory", "drift"] = torch.tensor([offset, 0.0, 0.0, 0.0]).expand(6, 4).clone()
        start["robot_state"][:, 0] += moved
        torch.manual_seed(1)
        costs.append(ImaginationLoss(PlainPolicy(G1).deployed(), model, task, steps=2)(start)["imagined_cost"])
    torch.testing.assert_close(*costs, atol=1e-5, rtol=0)


def test_an_estimate_has_the_true_velocity_and_tilt(task):
    torch.manual_seed(0)
    state, memory = task.start(5)
    state = state._replace(root_lin_vel_w=torch.randn(5, 3))
    memory["drift"] = torch.randn(5, 4)
    here = estimated(state, memory)
    assert (here.root_pos_w - state.root_pos_w).norm(dim=-1).min() > 0.1
    for ours, theirs in zip(here.in_root_frame(), state.in_root_frame(), strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0)


def test_targets_that_the_model_is_told_are_those_of_the_motors(task):
    env = SimulatedTask(task, 6, randomization=RANGES)
    state = env.reset()
    for _ in range(3):
        state["action"] = 0.3 * torch.randn(6, 29)
        told, _ = told_to_model(G1, state, state["action"])
        state = env.step(state)["next"]
        motors = torch.from_numpy(env.physics.batch.bind("ctrl")).float()
        torch.testing.assert_close(motors, told)


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


def test_noise_and_biases_are_the_same_in_physical_units_however_a_table_scales(task, rollout):
    state, memory = (rollout[1][name][:, 3] for name in ("robot_state", "memory"))
    state = GeneralizedState.unpack(state)
    factors = {"joint_pos": 2.0, "joint_vel": 0.05, "root_ang_vel_b": -0.25, "root_lin_vel_b": 4.0, "gravity_b": 3.0}
    robot = tuple(replace(entry, scale=factors.get(entry.name, 1.0)) for entry in OBSERVATION.entries("robot"))
    entries = ([(group, name) for name in factors] for group in ("robot", "seen"))
    reader = TensorDictModule(lambda *seen: seen, *entries)

    def measured():
        torch.manual_seed(0)
        return measuring(reader, NoiseLevels())(shown(task, state, memory))["seen"]

    plain = measured()
    with observing(ObservationTable({**OBSERVATION.groups, "robot": robot})):
        scaled = measured()
    for name, factor in factors.items():
        torch.testing.assert_close(scaled[name] / factor, plain[name], msg=name)
    assert memory["encoder_bias"].any()
    assert memory["gyro_bias"].any()


def test_strength_zero_is_the_nominal_robot():
    ranges = RandomizationRanges().scaled(0.0)
    assert ranges.foot_friction == (1.0, 1.0)
    assert ranges.motor_gain == ranges.control_delay == ranges.encoder_bias == 0
    assert RandomizationRanges().scaled(1.0) == RandomizationRanges()
