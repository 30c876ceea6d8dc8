import pytest
import torch
from tensordict import TensorDict

from plat.baselines import Twist2
from plat.rotations import quat_from_rotvec, quat_multiply


@pytest.fixture
def seen(monkeypatch) -> list[torch.Tensor]:
    """What the network is shown; it answers with ones."""
    rows: list[torch.Tensor] = []

    class Recorder:
        def __init__(self, path, inputs, outputs):
            assert (inputs, outputs) == (1432, 29)

        def __call__(self, observation):
            rows.append(observation)
            return torch.ones(len(observation), 29)

    monkeypatch.setattr("plat.baselines.twist2.OnnxPolicy", Recorder)
    return rows


def situation(tracker: Twist2, starting: bool) -> TensorDict:
    yaw = quat_from_rotvec(torch.tensor([[0.0, 0.0, torch.pi / 2]]))
    pitch = quat_from_rotvec(torch.tensor([[0.0, 0.3, 0.0]]))
    roll = quat_from_rotvec(torch.tensor([[0.2, 0.0, 0.0]]))
    gravity = torch.tensor([[torch.tensor(0.1).sin(), 0.0, -torch.tensor(0.1).cos()]])  # pitched by 0.1 rad
    return TensorDict(
        {
            "robot": TensorDict(
                {
                    "joint_pos": torch.full((1, 29), 0.05) - tracker.robot.default_joint_pos,
                    "joint_vel": torch.full((1, 29), 2.0),
                    "root_ang_vel_b": torch.tensor([[0.4, 0.8, 1.2]]),
                    "gravity_b": gravity,
                },
                [1],
            ),
            "tracker_reference": TensorDict(
                {
                    "joint_pos": torch.arange(29.0)[None],
                    "root_pos_w": torch.tensor([[5.0, 6.0, 0.7]]),
                    "root_quat_w": quat_multiply(yaw, quat_multiply(pitch, roll)),
                    "root_lin_vel_w": torch.tensor([[0.0, 0.5, 9.0]]),
                    "root_ang_vel_w": torch.zeros(1, 3),
                },
                [1],
            ),
            "is_init": torch.tensor([[starting]]),
        },
        [1],
    )


def test_what_it_sees(seen):
    tracker = Twist2("anywhere")
    tracker(situation(tracker, starting=True))
    row = seen[0][0]
    command = row[:35]
    # heading along y: a velocity along y is forward
    torch.testing.assert_close(command[:6], torch.tensor([0.5, 0.0, 0.7, 0.2, 0.3, 0.0]), atol=1e-5, rtol=0)
    assert command[6:].tolist() == list(range(29))
    torch.testing.assert_close(row[35:40], torch.tensor([0.1, 0.2, 0.3, 0.0, 0.1]), atol=1e-5, rtol=0)
    torch.testing.assert_close(row[40:43], torch.tensor([0.25, 0.05, 0.05]))  # hip pitch rests at -0.2
    joint_vel = row[69:98]
    names = tracker.robot.joint_names
    assert all(
        speed == (0.0 if "ankle" in name else pytest.approx(0.1)) for name, speed in zip(names, joint_vel, strict=True)
    )
    assert (row[98:127] == 0).all()
    assert (row[127:1397] == 0).all()
    assert torch.equal(row[1397:], command)


def test_history_is_oldest_first_and_ends_with_the_step_before(seen):
    tracker = Twist2("anywhere")
    for starting in (True, False, False):
        tracker(situation(tracker, starting))
    past = seen[2][0, 127:1397].view(10, 127)
    assert (past[:8] == 0).all()
    assert torch.equal(past[8], seen[0][0, :127])
    assert torch.equal(past[9], seen[1][0, :127])
    assert (seen[2][0, 98:127] == 1).all()  # the last action


def test_what_its_action_means(seen):
    tracker = Twist2("anywhere")
    action = tracker(situation(tracker, starting=True))["action"]
    targets = (tracker.robot.default_joint_pos + tracker.robot.action_scale * action)[0]
    names = tracker.robot.joint_names
    for joint, rest in (
        ("left_hip_pitch", -0.2),
        ("right_knee", 0.4),
        ("left_shoulder_roll", 0.4),
        ("right_shoulder_roll", -0.4),
        ("right_elbow", 1.2),
    ):
        assert targets[names.index(joint)] == pytest.approx(rest + 0.5, abs=1e-5)
