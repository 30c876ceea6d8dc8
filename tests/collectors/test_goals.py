import math

import pytest
import torch
from tensordict import TensorDict

from plat.collectors import PrivilegedGoals, strided_offsets
from plat.envs import make_keyframe_env, robot_centric_goal
from plat.errors import TaskError
from plat.motions import MotionLibrary


@pytest.mark.parametrize("stride", [1, 2, 5, 7, 60])
def test_offsets(stride):
    steps = torch.arange(1, 51)
    offset, length = strided_offsets(steps, stride)
    for row, count in enumerate(steps.tolist()):
        frames = offset[row, : length[row]].tolist()
        assert frames == sorted({*range(0, count, stride), count})
        assert (offset[row, length[row] :] == count).all()


def test_sequences_are_no_longer_than_needed():
    offset, _ = strided_offsets(torch.tensor([3, 4]), 1)
    assert offset.shape == (2, 5)


@pytest.mark.parametrize("stride", [1, 5])
def test_last_frame_is_the_commanded_keyframe(library: MotionLibrary, stride: int):
    states = PrivilegedGoals(library, stride)(make_keyframe_env(library, 32).reset())
    length = states["privileged_goal", "length"]
    last = states["privileged_goal", "frames"][torch.arange(32), length - 1]
    sparse = torch.cat(
        [states["goal", key] for key in ("joint_pos", "root_pos_b", "root_rot6d_b", "keypoint_pos_b")], -1
    )
    torch.testing.assert_close(last, sparse)


def test_every_frame_is_in_the_current_frame_of_the_robot(library: MotionLibrary):
    states = PrivilegedGoals(library)(make_keyframe_env(library, 8).reset())
    root = (states["estimate", "root_pos_w"], states["estimate", "root_quat_w"])
    for offset in range(3):
        frame = (states["motion", "frame"] + offset).minimum(states["command", "target_frame"])
        goal = robot_centric_goal(library.poses(frame), *root)
        torch.testing.assert_close(states["privileged_goal", "frames"][:, offset], torch.cat(list(goal.values()), -1))


def test_lookup_needs_only_where_to_look(library: MotionLibrary):
    lookup = TensorDict(
        {
            "motion": {"frame": torch.tensor([0, 5])},
            "command": {"steps_left": torch.tensor([[4], [9]])},
            "estimate": {"root_pos_w": torch.zeros(2, 3), "root_quat_w": torch.tensor([[1.0, 0, 0, 0]]).expand(2, 4)},
        },
        [2],
    )
    out = PrivilegedGoals(library, stride=3)(lookup)
    assert out["privileged_goal", "length"].tolist() == [3, 4]
    assert out["privileged_goal", "frames"].shape == (2, 4, 80)


@pytest.mark.parametrize("shape", [(3, 4), (12, 1), (1, 12), (2, 3, 2), (1, 1), (), (0,), (2, 0)])
def test_batches_of_any_depth(library: MotionLibrary, shape: tuple[int, ...]):
    states = make_keyframe_env(library, 12).reset()
    count = math.prod(shape)
    goals = PrivilegedGoals(library, 3)
    flat = goals(states[:count].clone())["privileged_goal"]
    deep = goals(states[:count].reshape(shape))["privileged_goal"]
    assert deep["length"].shape == shape
    assert torch.equal(deep["length"].flatten(), flat["length"])
    assert torch.equal(deep["frames"], flat["frames"].view(*shape, *flat["frames"].shape[1:]))


def test_environments_are_refused(library: MotionLibrary):
    with pytest.raises(TaskError, match="PrivilegedGoals is a transform of an environment, expected one of a replay"):
        make_keyframe_env(library, 1, transforms=[PrivilegedGoals(library)]).reset()


def test_stride_must_be_positive(library):
    with pytest.raises(ValueError, match="stride is 0, expected a whole number of at least 1"):
        PrivilegedGoals(library, 0)
