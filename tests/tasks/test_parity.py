"""One task, simulated and imagined: the environments' own numbers out of nothing but states and actions."""

from dataclasses import replace

import torch
from torchrl.envs import TransformedEnv

from plat.envs import GeneralizedState, KeyframeTaskConfig, TrackingTaskConfig, make_keyframe_env, make_tracking_env
from plat.envs.transforms import ReferenceMotion
from plat.modules import PlainPolicy, PlainPolicyConfig
from plat.robots import G1
from plat.rotations import quat_angle, quat_rotate
from plat.spec.observation import OBSERVATION, ObservationTable, observing
from plat.tasks import DenseTracking, SimulatedTask, TimedKeyframes, TimedKeyframesConfig

EXACT = {"atol": 1e-5, "rtol": 1e-5}
# a robot that is tossed about by random actions: nothing that a policy would do
CONFIG = TrackingTaskConfig(max_displacement=None)
KEYFRAMES = KeyframeTaskConfig(max_displacement=None)


def state_of(tensordict) -> GeneralizedState:
    """The state, of the entries that the training environments keep."""
    robot, quat = tensordict["robot"], tensordict["state", "root_quat_w"]
    return GeneralizedState(
        tensordict["state", "root_pos_w"],
        quat,
        robot["joint_pos"] + G1.default_joint_pos,
        quat_rotate(quat, robot["root_lin_vel_b"]),
        robot["root_ang_vel_b"],
        robot["joint_vel"],
    )


def steps_of(env, count):
    """Successive steps: what a policy is shown, and under ``"next"`` what its random action led to."""
    tensordict = env.reset()
    for _ in range(count):
        tensordict["action"] = 0.5 * torch.randn(*env.batch_size, G1.num_joints)
        tensordict, following = env.step_and_maybe_reset(tensordict)
        yield tensordict
        tensordict = following


def assert_same(observed, simulated):
    for group, entries in observed.items():
        for key, value in entries.items():
            torch.testing.assert_close(
                value, simulated[group, key], **EXACT, msg=lambda text, at=(group, key): f"{at}: {text}"
            )


def tracking_cost(simulated, reference):
    """The cost of dense tracking once more, from other entries."""
    pos, quat = simulated["root_pos_w"], simulated["root_quat_w"]
    wanted_pos, wanted_quat = reference["keypoint_pos_w"][:, 0], reference["keypoint_quat_w"][:, 0]
    return (
        2.0 * ((pos - wanted_pos).square().sum(-1) + 1e-4).sqrt()
        + quat_angle(quat, wanted_quat)
        + 3.0 * (simulated["joint_pos"] - reference["joint_pos"]).abs().mean(-1)
        + 0.2
        * (
            (simulated["keypoint_lin_vel_w"][:, 0] - reference["keypoint_lin_vel_w"][:, 0]).square().sum(-1) + 1e-4
        ).sqrt()
        + 0.03 * (simulated["joint_vel"] - reference["joint_vel"]).abs().mean(-1)
    )


def test_dense_tracking_is_the_tracking_environment(library):
    goals = {"goal": 1, "goal_7": 7}
    env = make_tracking_env(library, 5, CONFIG, goals=goals)
    task = DenseTracking(library, goals)
    ended = 0
    for before in steps_of(env, 40):
        after, going_on = before["next"], ~before["next", "done"][:, 0]
        memory = task.start(5)[1]
        memory["frame"], memory["last_action"] = before["motion", "frame"], before["robot", "last_action"]
        assert_same(task.observe(state_of(before), memory), before)
        memory = task.advance(memory, before["action"])
        assert memory["frame"].equal(after["motion", "frame"])
        assert_same(task.observe(state_of(after), task.renew(memory, state_of(after)))[going_on], after[going_on])
        assert task.finished(memory).equal(after["truncated"][:, 0])
        ended += int((~going_on).sum())
    assert ended > 0


def test_dense_cost_is_the_distance_from_the_reference(library):
    base = make_tracking_env(library, 5, CONFIG).base_env
    env = TransformedEnv(base, ReferenceMotion(library))
    task = DenseTracking(library)
    for before in steps_of(env, 10):
        after = before["next"]
        memory = task.start(5)[1].set("frame", after["motion", "frame"])
        state = GeneralizedState.from_entries(after)
        wanted = tracking_cost(after["state"], after["reference"])
        wanted = wanted + 0.05 * (
            state.root_ang_vel_b - GeneralizedState.from_motion(library.states(after["motion", "frame"])).root_ang_vel_b
        ).abs().mean(-1)
        # the angle is rounded at 0
        torch.testing.assert_close(task.cost(state, memory), wanted, atol=1e-4, rtol=1e-4)


def test_timed_keyframes_are_the_keyframe_environment(library):
    env = make_keyframe_env(library, 5, KEYFRAMES)
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6, families=("arms",)))
    renewed = 0
    for before in steps_of(env, 80):
        after, going_on = before["next"], ~before["next", "done"][:, 0]
        memory = task.along(before["motion", "frame"])[1]
        memory["last_action"] = before["robot", "last_action"]
        memory["goal"], memory["steps_left"] = before["command", "target_frame"], before["command", "steps_left"][:, 0]
        assert_same(task.observe(state_of(before), memory), before)
        memory = task.advance(memory, before["action"])
        assert memory["frame"].equal(after["motion", "frame"])
        assert (memory["steps_left"] < task.timing.window).equal(after["command", "in_window"][:, 0])
        assert (memory["steps_left"] == 0).equal(after["command", "arrived"][:, 0])
        # the same command goes on in both, and where it is over both set another one
        same = going_on & ~after["command", "arrived"][:, 0]
        new = task.renew(memory, state_of(after))
        assert new["steps_left"][same].equal(after["command", "steps_left"][same, 0])
        assert new["goal"][same].equal(after["command", "target_frame"][same])
        assert (new["steps_left"] >= 1).all()
        assert (new["steps_left"] <= 50).all()
        assert_same(task.observe(state_of(after), new)[same], after[same])
        assert task.finished(memory).equal(after["truncated"][:, 0])
        renewed += int((going_on & after["command", "arrived"][:, 0]).sum())
    assert renewed > 5


def test_both_show_quantities_as_the_table_scales_them(library):
    """By the table of a user who wants joint velocities at a twentieth and four times the time left."""
    scales = {"robot": ("joint_vel", 0.05), "command": ("horizon", 4.0)}
    groups = {
        group: tuple(
            replace(entry, scale=scales[group][1]) if group in scales and entry.name == scales[group][0] else entry
            for entry in entries
        )
        for group, entries in OBSERVATION.groups.items()
    }
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6, families=("arms",)))
    state, memory = task.along(torch.arange(5))
    plain = task.observe(state, memory)
    with observing(ObservationTable(groups)):
        scaled = task.observe(state, memory)
    torch.testing.assert_close(scaled["robot", "joint_vel"], 0.05 * plain["robot", "joint_vel"])
    torch.testing.assert_close(scaled["command", "horizon"], 4 * plain["command", "horizon"])
    assert plain["robot", "joint_vel"].any()


def test_no_robot_to_reset_is_none(library):
    for env in (make_keyframe_env(library, 3, KEYFRAMES), SimulatedTask(DenseTracking(library), 3)):
        before = env.reset()
        after = env.reset(before.clone().set("_reset", torch.zeros(3, 1, dtype=torch.bool)))
        for key in ("robot", "goal"):
            assert_same(after.select(key), before)


def test_the_simulated_task_costs_what_an_imagined_one_would(library):
    for task in (DenseTracking(library), TimedKeyframes(library, TimedKeyframesConfig(chains=12))):
        env = SimulatedTask(task, 6)
        for before in steps_of(env, 20):
            after = before["next"]
            memory = task.advance(before["memory"], before["action"])
            state = GeneralizedState.unpack(after["robot_state"])
            torch.testing.assert_close(-after["reward"][:, 0], task.cost(state, memory), **EXACT)
            going_on = ~after["done"][:, 0]
            assert after["memory", "last_action"].equal(before["action"])
            assert_same(task.observe(state, after["memory"])[going_on], after[going_on])


def test_a_policy_that_sees_parts_acts_alike_on_whole_keyframes(library):
    small = {"backbone": (16,), "hidden_size": 16, "decoder": (16,)}
    policy = PlainPolicy(G1, PlainPolicyConfig(**small, also=("parts", "clock"))).deployed()
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6, families=("arms",)))
    for before in steps_of(make_keyframe_env(library, 5, KEYFRAMES), 3):
        memory = task.along(before["motion", "frame"])[1]
        memory["last_action"] = before["robot", "last_action"]
        memory["goal"], memory["steps_left"] = before["command", "target_frame"], before["command", "steps_left"][:, 0]
        observed = task.observe(state_of(before), memory)
        assert set(observed["parts"].keys()) == {"joints", "bodies", "root"}
        torch.testing.assert_close(policy(observed)["action"], policy(before.copy())["action"], **EXACT)
    simulated = SimulatedTask(task, 6)
    for before in steps_of(simulated, 20):
        going_on = ~before["next", "done"][:, 0]
        shown = task.observe(GeneralizedState.unpack(before["next", "robot_state"]), before["next", "memory"])
        imagined = policy(shown)["action"]
        torch.testing.assert_close(policy(before["next"].copy())["action"][going_on], imagined[going_on], **EXACT)
