import numpy as np
import pytest
import torch

from plat.deploy import ObservationBuilder, RobotState, observation_terms
from plat.envs import KeyframeTaskConfig, make_keyframe_env
from plat.errors import ConfigError, ObservationError, StateError
from plat.modules import STUDENT_KEYS
from plat.robots import G1
from plat.spec.observation import entry_shapes, student_keys
from plat.spec.parts import Parts
from tests.deploy.robots import SomePose, describe_g1, random_qpos, state_at


@pytest.fixture(scope="module")
def build() -> ObservationBuilder:
    return ObservationBuilder(describe_g1(), 50)


def test_terms_are_what_students_are_trained_on():
    terms = observation_terms(G1.num_joints, len(G1.keypoints))
    assert [tuple(term.name.split(".")) for term in terms] == list(STUDENT_KEYS)
    start = 0
    for term, (group, name) in zip(terms, STUDENT_KEYS, strict=True):
        assert (term.start, term.stop) == (start, start + entry_shapes(group, G1)[name][0])
        start = term.stop


def test_agrees_with_the_environment(build, library):
    env = make_keyframe_env(library, num_envs=4)
    rollout = env.rollout(
        12, lambda tensordict: tensordict.set("action", torch.randn(4, 29)), break_when_any_done=False
    )
    for step in rollout.flatten():
        pose = library.poses(step["command", "target_frame"])
        target = torch.cat((pose["keypoint_pos"][0], pose["keypoint_quat"][0], pose["joint_pos"]))
        robot, root = step["robot"], step["state"]
        state = RobotState(
            joint_pos=(robot["joint_pos"] + G1.default_joint_pos).numpy(),
            joint_vel=robot["joint_vel"].numpy(),
            root_pos_w=root["root_pos_w"].numpy(),
            root_quat_w=root["root_quat_w"].numpy(),
            root_lin_vel_b=robot["root_lin_vel_b"].numpy(),
            root_ang_vel_b=robot["root_ang_vel_b"].numpy(),
        )
        ours = build(state, SomePose(target.numpy()), int(step["command", "steps_left"]), robot["last_action"].numpy())
        expected = torch.cat([step[key] for key in STUDENT_KEYS])
        np.testing.assert_allclose(ours, expected, atol=5e-6)


def test_agrees_with_the_environment_on_partial_keyframes(library):
    build = ObservationBuilder(describe_g1(), 50, ("parts", "clock"))
    keys = student_keys(("parts", "clock"))
    assert [tuple(term.name.split(".")) for term in build.terms] == list(keys)
    env = make_keyframe_env(library, 6, KeyframeTaskConfig(partial=0.8, max_displacement=None))
    rollout = env.rollout(
        40, lambda tensordict: tensordict.set("action", torch.randn(6, 29)), break_when_any_done=False
    )
    partial = 0
    for step in rollout.flatten():
        pose = library.poses(step["command", "target_frame"])
        robot, root, mask = step["robot"], step["state"], step["command", "parts"]
        state = RobotState(
            joint_pos=(robot["joint_pos"] + G1.default_joint_pos).numpy(),
            joint_vel=robot["joint_vel"].numpy(),
            root_pos_w=root["root_pos_w"].numpy(),
            root_quat_w=root["root_quat_w"].numpy(),
            root_lin_vel_b=robot["root_lin_vel_b"].numpy(),
            root_ang_vel_b=robot["root_ang_vel_b"].numpy(),
        )
        target = SomePose(torch.cat((pose["keypoint_pos"][0], pose["keypoint_quat"][0], pose["joint_pos"])).numpy())
        target.commands = Parts.of_values(mask.tolist(), 29)
        partial += not target.commands.whole
        ours = build(state, target, int(step["command", "steps_left"]), robot["last_action"].numpy())
        np.testing.assert_allclose(ours, torch.cat([step[key] for key in keys]), atol=5e-6)
    assert partial > 100


def test_a_policy_for_whole_poses_refuses_parts(build):
    now, target = random_qpos(2)
    pose = SomePose(target)
    pose.commands = Parts.only(G1, joints=["left_elbow"])
    with pytest.raises(StateError, match="trained on whole poses"):
        build(state_at(now), pose, 10, np.zeros(29))
    pose.commands = Parts.all(G1)
    assert build(state_at(now), pose, 10, np.zeros(29)).shape == (177,)


def test_a_pose_that_is_changed_in_place_is_seen(build):
    now, target = random_qpos(2)
    state, pose = state_at(now), SomePose(target)
    before = build(state, pose, 10, np.zeros(29))
    pose.root_pos[2] += 0.1
    after = build(state, pose, 10, np.zeros(29))
    assert not np.allclose(before, after)
    np.testing.assert_array_equal(after, ObservationBuilder(describe_g1(), 50)(state, pose, 10, np.zeros(29)))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("joint_pos", np.zeros(28), r"robot state: joint_pos has shape \(28,\), expected \(29,\)"),
        ("joint_pos", "rest", r"robot state: joint_pos has shape \(\), expected \(29,\)"),
        ("joint_vel", [[0.0], [0.0, 1.0]], r"robot state: joint_vel has shape \(\), expected \(29,\)"),
        ("root_pos_w", ["0", "0", "0.76"], "robot state: root_pos_w holds '0', expected numbers"),
        ("root_pos_w", np.array([0, np.nan, 0]), r"robot state: root_pos_w\[1\] is nan, expected a finite number"),
        ("root_quat_w", np.full(4, np.nan), r"robot state: root_quat_w\[0\] is nan"),
        ("root_quat_w", np.zeros(4), r"robot state: root_quat_w has length 0, expected a unit quaternion wxyz"),
        ("joint_vel", np.full(29, np.inf), r"robot state: joint_vel\[0\] is inf"),
        # what a driver gives when a motor does not answer
        ("joint_vel", [None] * 29, "robot state: joint_vel holds None, expected numbers"),
        ("joint_vel", ["0.1"] * 29, "robot state: joint_vel holds '0.1', expected numbers"),
        ("joint_pos", None, r"robot state: joint_pos has shape \(\), expected \(29,\)"),
    ],
)
def test_a_broken_state(build, field, value, message):
    now, target = random_qpos(2)
    state = state_at(now)
    setattr(state, field, value)
    with pytest.raises(StateError, match=message):
        build(state, SomePose(target), 10, np.zeros(29))


def test_no_state_and_no_keyframe(build):
    now, target = random_qpos(2)
    with pytest.raises(StateError, match="robot state: joint_pos has shape"):
        build(None, SomePose(target), 10, np.zeros(29))
    with pytest.raises(StateError, match="keyframe: root_pos has shape"):
        build(state_at(now), None, 10, np.zeros(29))


@pytest.mark.parametrize("commands", ["left_elbow", ["left_elbow"], 5, {"joints": ["left_elbow"]}, np.ones(46)])
def test_commands_that_are_no_parts(commands):
    build, (now, target) = ObservationBuilder(describe_g1(), 50, ("parts",)), random_qpos(2)
    pose = SomePose(target)
    pose.commands = commands
    with pytest.raises(StateError, match=r"keyframe: commands is .*, expected plat.spec.parts.Parts or None"):
        build(state_at(now), pose, 10, np.zeros(29))


def test_all_parts_of_another_robot_are_not_a_whole_pose(build):
    now, target = random_qpos(2)
    pose = SomePose(target)
    pose.commands = Parts((True,) * 12, (True,) * 3, (True, True, True))
    with pytest.raises(StateError, match="keyframe: commands has 18 flags, expected 46"):
        build(state_at(now), pose, 10, np.zeros(29))


@pytest.mark.parametrize(
    ("steps_left", "last_action", "message"),
    [
        (None, np.zeros(29), "steps_left is None, expected a finite number"),
        ("10", np.zeros(29), "steps_left is '10', expected a finite number"),
        (np.array([10.0]), np.zeros(29), r"steps_left is array\(\[10.\]\), expected a finite number"),
        (10, np.zeros(28), r"last_action has shape \(28,\), expected \(29,\)"),
        (10, 0.0, r"last_action has shape \(\), expected \(29,\)"),
        (10, np.full(29, np.nan), r"last_action\[0\] is nan, expected a finite number"),
    ],
)
def test_a_step_that_is_none(build, steps_left, last_action, message):
    now, target = random_qpos(2)
    with pytest.raises(StateError, match=message):
        build(state_at(now), SomePose(target), steps_left, last_action)


def test_commands_take_a_step_at_least():
    with pytest.raises(ConfigError, match="max_steps is 0, expected a whole number of at least 1"):
        ObservationBuilder(describe_g1(), 0)


def test_tensors_are_numbers_too(build):
    now, target = random_qpos(2)
    ours = build(state_at(now), SomePose(target), 10, np.zeros(29))
    state, pose = state_at(now), SomePose(target)
    for thing in (state, pose):
        for name, value in vars(thing).items():
            setattr(thing, name, torch.from_numpy(np.array(value)))
    theirs = build(state, pose, np.array(10.0), torch.zeros(29))
    np.testing.assert_array_equal(ours, theirs)
    pose.root_pos[2] += 0.1
    assert not np.array_equal(ours, build(state, pose, torch.tensor(10), torch.zeros(29)))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("joint_pos", np.zeros(30), r"keyframe: joint_pos has shape \(30,\), expected \(29,\)"),
        ("root_pos", np.array([0, 0, np.nan]), r"keyframe: root_pos\[2\] is nan"),
        ("root_quat", np.array([0.0, 0, 0, 2]), "keyframe: root_quat has length 2, expected a unit quaternion wxyz"),
    ],
)
def test_a_broken_keyframe(build, field, value, message):
    now, target = random_qpos(2)
    pose = SomePose(target)
    setattr(pose, field, value)
    with pytest.raises(StateError, match=message):
        build(state_at(now), pose, 10, np.zeros(29))


def test_a_group_that_there_is_none_of_is_not_left_out():
    for build in (
        lambda also: ObservationBuilder(describe_g1(), 50, also),
        lambda also: observation_terms(29, 14, also),
    ):
        with pytest.raises(ObservationError, match="observation group 'clok': expected some of"):
            build(("parts", "clok"))
    assert ObservationBuilder(describe_g1(), 50, "clock").also == ("clock",)
