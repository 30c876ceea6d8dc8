import pytest
import torch
from tensordict import TensorDict

from plat.baselines import Wbc
from plat.robots import G1
from plat.rotations import quat_from_rotvec


@pytest.fixture
def seen(monkeypatch) -> list[torch.Tensor]:
    """What the network is shown; it answers with ones."""
    rows: list[torch.Tensor] = []

    class Recorder:
        def __init__(self, path, inputs, outputs):
            assert (inputs, outputs) == (132, 29)

        def __call__(self, observation):
            rows.append(observation)
            return torch.ones(len(observation), 29)

    monkeypatch.setattr("plat.baselines.wbc.OnnxPolicy", Recorder)
    return rows


def situation(starting: bool) -> TensorDict:
    return TensorDict(
        {
            "robot": TensorDict(
                {
                    "joint_pos": torch.zeros(1, 29) - G1.default_joint_pos,
                    "joint_vel": torch.full((1, 29), 2.0),
                    "root_ang_vel_b": torch.tensor([[0.4, 0.8, 1.2]]),
                    "gravity_b": torch.tensor([[0.0, 0.6, -0.8]]),
                },
                [1],
            ),
            "tracker_reference": TensorDict(
                {
                    "joint_pos": torch.arange(29.0)[None],
                    "anchor_pos_w": torch.tensor([[5.0, 6.0, 0.81]]),
                    "root_quat_w": quat_from_rotvec(torch.tensor([[0.0, 0.0, torch.pi / 2]])),
                    "root_lin_vel_w": torch.tensor([[0.0, 0.5, 0.1]]),
                    "root_ang_vel_w": torch.tensor([[0.3, 0.0, 0.2]]),
                },
                [1],
            ),
            "is_init": torch.tensor([[starting]]),
        },
        [1],
    )


def test_what_it_sees(seen):
    tracker = Wbc("anywhere")
    for starting in (True, False):
        tracker(situation(starting))
    row = seen[0][0]
    expected = torch.tensor([0.81, 0.5, 0.0, 0.1, 0.0, -0.3, 0.2, 0.0, 0.0, -1.0])
    torch.testing.assert_close(row[:10], expected, atol=1e-5, rtol=0)
    assert row[10:39].tolist() == list(range(29))
    torch.testing.assert_close(row[39:45], torch.tensor([0.4, 0.8, 1.2, 0.0, 0.6, -0.8]))
    rest = dict(zip(G1.joint_names, (-row[45:74]).tolist(), strict=True))
    assert rest["left_hip_pitch"] == pytest.approx(-0.1)
    assert rest["right_shoulder_roll"] == pytest.approx(-0.18)
    assert rest["waist_yaw"] == 0
    assert (row[74:103] == 2.0).all()
    assert (row[103:] == 0).all()
    assert (seen[1][0, 103:] == 1).all()


def test_its_action_is_added_to_the_reference(seen):
    action = Wbc("anywhere")(situation(starting=True))["action"]
    offset = (G1.default_joint_pos + G1.action_scale * action)[0] - torch.arange(29.0)
    names = G1.joint_names
    for joint, scale in (
        ("left_knee", 0.33048),
        ("waist_yaw", 0.51830),
        ("left_elbow", 0.55962),
        ("right_wrist_yaw", 0.12814),
    ):
        assert offset[names.index(joint)] == pytest.approx(scale, abs=1e-4)
