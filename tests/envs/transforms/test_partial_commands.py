"""Partial keyframes in the environment: what is shown, judged and paid."""

import torch
from tensordict import TensorDict

from plat.envs import KeyframeTaskConfig, make_keyframe_env
from plat.envs.transforms import KeyframeMetrics
from plat.envs.transforms.reward_terms import commanded_difference, commanded_joint_pos_error
from plat.envs.transforms.settings import TerminationLimits
from plat.envs.transforms.terminations import fallen, off_pose
from plat.robots import G1
from plat.spec.parts import Parts

LEFT, RIGHT = (G1.keypoints.index(f"{side}_wrist_yaw_link") for side in ("left", "right"))


def flags(**names):
    return torch.tensor(Parts.only(G1, **names).values(), dtype=torch.float32)[None]


def poses(height=0.76, **moved):
    """A standing robot's keypoints, with some bodies moved up (m)."""
    pos = torch.zeros(1, 14, 3)
    pos[..., 2] = height
    for name, by in moved.items():
        pos[0, {"left": LEFT, "right": RIGHT}[name], 2] += by
    quat = torch.tensor([1.0, 0, 0, 0]).expand(1, 14, 4).clone()
    return TensorDict({"keypoint_pos_w": pos, "keypoint_quat_w": quat, "joint_pos": torch.zeros(1, 29)}, [1])


def off(state, parts):
    return bool(off_pose(state, poses(), G1, TerminationLimits(), parts))


def test_only_commanded_bodies_are_judged():
    raised = poses(right=0.6)
    assert off(raised, None)
    assert off(raised, flags(bodies=["right_wrist_yaw_link"]))
    assert not off(raised, flags(bodies=["left_wrist_yaw_link"]))


def test_all_parts_are_a_whole_keyframe():
    everything = torch.ones(1, 46)
    for state in (poses(), poses(right=0.6), poses(height=0.3)):
        assert off(state, everything) == off(state, None)


def test_a_fall_is_a_fall_whatever_is_commanded():
    hands = flags(bodies=["left_wrist_yaw_link"])
    assert fallen(poses(height=0.2), poses(), G1, TerminationLimits(), hands).all()
    assert off(poses(height=0.2, left=0.56), hands)
    # lower than the reference, but on its feet: the height was not commanded
    low = poses(height=0.45)
    assert fallen(low, poses(height=0.78), G1, TerminationLimits(), None).all()
    assert not fallen(low, poses(height=0.78), G1, TerminationLimits(), hands).any()


def test_errors_are_over_what_is_commanded():
    state, reference = poses(right=0.3), poses()
    state["joint_pos"][:, 3] = 0.4
    error, there = commanded_joint_pos_error(state, reference, flags(joints=["left_knee", "left_elbow"]))
    assert there.all()
    torch.testing.assert_close(error, torch.tensor([0.4**2 / 2]))
    bodies = commanded_difference("keypoint_pos_w")
    error, there = bodies(state, reference, flags(bodies=["right_wrist_yaw_link"]))
    torch.testing.assert_close(error, torch.tensor([0.09]))
    assert not bodies(state, reference, flags(joints=["left_knee"]))[1].any()
    # of the root the axes that are commanded
    state["keypoint_pos_w"][:, 0] += torch.tensor([0.3, 0.4, 0.5])
    for root, squared in ((["horizontal"], 0.25), (["height"], 0.25), (["horizontal", "height"], 0.5)):
        error, there = bodies(state, reference, flags(root=root))
        torch.testing.assert_close(error, torch.tensor([squared]))
        assert there.all()


def test_commands_of_an_environment_are_partial_for_their_whole_time(library):
    env = make_keyframe_env(library, 8, KeyframeTaskConfig(partial=0.7))
    env.insert_transform(2, KeyframeMetrics(library))
    tensordict = env.reset()
    partial = []
    for _ in range(60):
        tensordict["action"] = torch.zeros(8, 29)
        stepped = env.step(tensordict)
        before, after = stepped["command", "parts"], stepped["next", "command", "parts"]
        going_on = (stepped["command", "steps_left"] > 1)[:, 0] & ~stepped["next", "done"][:, 0]
        assert before[going_on].equal(after[going_on])
        shown = torch.cat([stepped["parts", name] for name in ("joints", "bodies", "root")], -1)
        assert shown.equal(before)
        assert (stepped["goal", "joint_pos"][before[:, :29] == 0] == 0).all()
        no_joints = before[:, :29].sum(-1) == 0
        assert stepped["next", "metrics", "joint_error"][no_joints].isnan().all()
        assert stepped["next", "metrics", "joint_error"][~no_joints].isfinite().all()
        assert stepped["next", "reward"].isfinite().all()
        partial.append((before < 1).any(-1))
        tensordict = env.maybe_reset(env.step_mdp(stepped))
    assert 0.4 < torch.stack(partial).float().mean() < 0.95


def test_whole_keyframes_carry_no_mask(library):
    tensordict = make_keyframe_env(library, 2).reset()
    assert ("command", "parts") not in tensordict.keys(True)
    assert (tensordict["parts", "bodies"] == 1).all()
