import pytest
import torch
from tensordict import TensorDict

from plat.envs.transforms import KeyframeMetrics
from plat.motions import MotionLibrary
from plat.rotations import quat_from_rotvec, quat_multiply, quat_rotate
from tests.conftest import standing_clip


@pytest.fixture(scope="module")
def metrics_library() -> MotionLibrary:
    return MotionLibrary.from_clips([standing_clip()])


def step(library: MotionLibrary) -> tuple[TensorDict, TensorDict]:
    states = library.states(torch.tensor([20, 30]))
    shared = {
        "joint_pos": states["joint_pos"],
        "keypoint_pos_w": states["keypoint_pos"],
        "keypoint_quat_w": states["keypoint_quat"],
    }
    robot = {
        **shared,
        "joint_vel": torch.zeros(2, 29),
        "keypoint_lin_vel_w": torch.zeros(2, 14, 3),
        "foot_force": torch.tensor([[100.0, 100.0], [100.0, 0.0]]),
    }
    after = TensorDict({"state": TensorDict(robot, [2]).clone(), "reference": TensorDict(shared, [2]).clone()}, [2])
    before = TensorDict({"action": torch.zeros(2, 29), "robot": {"last_action": torch.zeros(2, 29)}}, [2])
    return before, after


def measured(library: MotionLibrary, before: TensorDict, after: TensorDict) -> TensorDict:
    return KeyframeMetrics(library)._step(before, after)["metrics"]


def test_on_the_reference_every_error_is_zero(metrics_library):
    for value in measured(metrics_library, *step(metrics_library)).values():
        assert value.abs().max() < 1e-5


def test_joint_error_is_the_mean_of_absolute_angles(metrics_library):
    before, after = step(metrics_library)
    after["state", "joint_pos"][:, 0] += 0.29
    after["state", "joint_pos"][:, 1] -= 0.29
    assert measured(metrics_library, before, after)["joint_error"][0].item() == pytest.approx(0.02, rel=1e-4)


def test_world_and_root_error_of_a_displaced_robot(metrics_library):
    before, after = step(metrics_library)
    turn = quat_from_rotvec(torch.tensor([0.0, 0.0, 0.5]))
    pos, quat = after["state", "keypoint_pos_w"], after["state", "keypoint_quat_w"]
    after["state", "keypoint_pos_w"] = pos + torch.tensor([0.3, 0.4, 0.0])
    values = measured(metrics_library, before, after)
    assert values["keypoint_error"][1].item() == pytest.approx(0.5, rel=1e-4)
    assert values["keypoint_error_root"].abs().max() < 1e-5
    # turned as well: still nothing in its own frame
    after["state", "keypoint_pos_w"] = quat_rotate(turn, pos)
    after["state", "keypoint_quat_w"] = quat_multiply(turn.expand_as(quat), quat)
    values = measured(metrics_library, before, after)
    assert values["keypoint_error_root"].abs().max() < 1e-5
    assert values["keypoint_error"].min() > 0.01


def test_one_wrong_keypoint_counts_a_fourteenth(metrics_library):
    before, after = step(metrics_library)
    after["state", "keypoint_pos_w"][:, 10, 2] += 0.14
    values = measured(metrics_library, before, after)
    assert values["keypoint_error"][0].item() == pytest.approx(0.01, rel=1e-3)
    assert values["keypoint_error_root"][0].item() == pytest.approx(0.01, rel=1e-3)


def test_smoothness_and_slip(metrics_library):
    before, after = step(metrics_library)
    before["action"] += 0.5
    feet = [metrics_library.robot.keypoints.index(foot) for foot in metrics_library.robot.feet]
    after["state", "keypoint_lin_vel_w"][:, feet, 0] = torch.tensor([0.2, 0.4])
    values = measured(metrics_library, before, after)
    torch.testing.assert_close(values["action_change"][:, 0], torch.tensor([0.5, 0.5]))
    torch.testing.assert_close(values["foot_slip"][:, 0], torch.tensor([0.3, 0.2]))  # the unloaded foot is free to move


def test_jerk_is_the_second_difference_of_velocity(metrics_library):
    metrics = KeyframeMetrics(metrics_library)
    jerks = []
    for index in range(5):
        before, after = step(metrics_library)
        after["state", "joint_vel"] += (0.02 * index) ** 2  # acceleration 2 t, jerk 2
        jerks.append(metrics._step(before, after)["metrics", "joint_jerk"][0].item())
    assert jerks[:2] == [0, 0]
    assert jerks[2:] == pytest.approx([2.0] * 3, rel=1e-3)
    # an episode's first steps have no past to compare with
    frame = {"motion": {"frame": torch.zeros(2, dtype=torch.int64)}}
    metrics._reset(TensorDict({"_reset": torch.tensor([[True], [False]])}, [2]), TensorDict(frame, [2]))
    before, after = step(metrics_library)
    after["state", "joint_vel"] += (0.02 * 5) ** 2
    jerk = metrics._step(before, after)["metrics", "joint_jerk"][:, 0]
    assert jerk[0] == 0
    assert jerk[1].item() == pytest.approx(2.0, rel=1e-3)


def test_who_begins_anew_has_no_jerk_of_the_episode_before(metrics_library):
    metrics = KeyframeMetrics(metrics_library)
    for _ in range(2):
        jerks = []
        for speed in (0.0, 3.0, 0.0, 3.0):
            before, after = step(metrics_library)
            after["state", "joint_vel"] += speed
            jerks.append(metrics._step(before, after)["metrics", "joint_jerk"][0].item())
        assert jerks[:2] == [0, 0]
        assert min(jerks[2:]) > 1000
        frame = TensorDict({"motion": {"frame": torch.zeros(2, dtype=torch.int64)}}, [2])
        metrics._reset(TensorDict({}, [2]), frame)


def test_fallen(metrics_library):
    before, after = step(metrics_library)
    after["state", "keypoint_pos_w"][0, 0, 2] -= 0.3
    assert measured(metrics_library, before, after)["fallen"][:, 0].tolist() == [1.0, 0.0]
