from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from plat.baselines import Sonic, Sonic11, sonic_robot
from plat.envs.transforms import HORIZONS
from plat.errors import BundleError
from plat.evaluation import evaluate
from plat.motions import MotionLibrary
from plat.robots import G1
from plat.rotations import quat_from_rotvec, quat_multiply
from tests.conftest import standing_clip

# joints of the order that the networks were trained in: left before right, from the pelvis outward
FIRST = ["left_hip_pitch", "right_hip_pitch", "waist_yaw", "left_hip_roll", "right_hip_roll", "waist_roll"]
LAST = ["left_wrist_pitch", "right_wrist_pitch", "left_wrist_yaw", "right_wrist_yaw"]


@pytest.fixture
def seen(monkeypatch) -> dict[str, list[torch.Tensor]]:
    """What the networks are shown; the encoder answers with twos, the decoder counts its calls up."""
    shown: dict[str, list[torch.Tensor]] = {"model_encoder.onnx": [], "model_decoder.onnx": []}

    class Recorder:
        def __init__(self, path, inputs, outputs):
            self.name, self.outputs = Path(path).name, outputs
            known = {"model_encoder.onnx": [(1762, 64), (1751, 64)], "model_decoder.onnx": [(994, 29)]}
            assert (inputs, outputs) in known[self.name]

        def __call__(self, observation):
            shown[self.name].append(observation)
            if self.name == "model_encoder.onnx":
                return torch.full((len(observation), 64), 2.0)
            return torch.full((len(observation), 29), float(len(shown[self.name])))

    monkeypatch.setattr("plat.baselines.sonic.OnnxPolicy", Recorder)
    return shown


def situation(step: int) -> TensorDict:
    """The robot at a step, turned by a quarter about z; the reference by a half, then pitched by 0.3 rad."""
    yaw = quat_from_rotvec(torch.tensor([[0.0, 0.0, torch.pi / 2]]))
    pitch = quat_from_rotvec(torch.tensor([[0.0, 0.3, 0.0]]))
    frames = torch.arange(10.0)
    robot = {
        "joint_pos": torch.arange(29.0)[None] + 100 * step,
        "joint_vel": -torch.arange(29.0)[None] - 100 * step,
        "root_ang_vel_b": torch.tensor([[0.4, 0.8, 1.2]]) + step,
        "gravity_b": torch.tensor([[0.0, 0.6, -0.8]]) + step,
    }
    reference = {
        "joint_pos": (torch.arange(29.0) + 1000 * frames[:, None])[None],
        "joint_vel": (-torch.arange(29.0) - 1000 * frames[:, None])[None],
        "root_quat_w": quat_multiply(yaw, quat_multiply(yaw, pitch)).expand(1, 10, 4),
    }
    return TensorDict(
        {
            "robot": TensorDict(robot, [1]),
            "tracker_reference": TensorDict(reference, [1]),
            "state": TensorDict({"root_quat_w": yaw}, [1]),
            "is_init": torch.tensor([[step == 0]]),
        },
        [1],
    )


def test_what_the_encoder_sees(seen):
    Sonic("anywhere")(situation(0))
    row = seen["model_encoder.onnx"][0][0]
    assert row.shape == (1762,)
    joint_pos, joint_vel = row[4:294].view(10, 29), row[294:584].view(10, 29)
    names = [G1.joint_names[int(joint)] for joint in joint_pos[0]]
    assert names[:6] == FIRST
    assert names[-4:] == LAST
    assert torch.equal(joint_pos - joint_pos[0], 1000 * torch.arange(10.0)[:, None].expand(10, 29))
    assert torch.equal(joint_vel, -joint_pos)
    turned = torch.tensor([0.0, -1.0, 1.0, 0.0, 0.0, 0.0])  # a quarter about z, and pitched: x points down by 0.3
    cos, sin = torch.tensor(0.3).cos(), torch.tensor(0.3).sin()
    turned[[2, 4]] = torch.stack((cos, -sin))
    torch.testing.assert_close(row[601:661].view(10, 6), turned.expand(10, 6), atol=1e-6, rtol=0)
    used = torch.zeros(1762, dtype=torch.bool)
    used[4:584] = used[601:661] = True
    assert (row[~used] == 0).all()


def test_the_encoder_of_1_1_sees_orientations_in_the_heading_frame(seen):
    entries = situation(0)
    tilt = quat_from_rotvec(torch.tensor([[0.4, 0.0, 0.0]]))
    upright = situation(0)["state", "root_quat_w"]
    entries["state", "root_quat_w"] = quat_multiply(upright, tilt)
    Sonic11("anywhere")(entries)
    row = seen["model_encoder.onnx"][0][0]
    assert row.shape == (1751,)
    Sonic("anywhere")(situation(0))
    first = seen["model_encoder.onnx"][1][0]
    assert torch.equal(row[:584], first[:584])
    # tilting the robot changes nothing, and the first release sees the same from a robot that is upright
    torch.testing.assert_close(row[584:644], first[601:661], atol=1e-6, rtol=0)
    assert (row[644:] == 0).all()


def test_what_the_decoder_sees(seen):
    tracker = Sonic("anywhere")
    for step in range(3):
        tracker(situation(step))
    row = seen["model_decoder.onnx"][2][0]
    assert row.shape == (994,)
    assert (row[:64] == 2).all()
    parts = row[64:].split([30, 290, 290, 290, 30])
    ang_vel, joint_pos, joint_vel, actions, gravity = (part.view(10, -1) for part in parts)
    steps = torch.tensor([0.0] * 8 + [1, 2])  # oldest first; the first measurement stands in for what is missing
    torch.testing.assert_close(ang_vel, torch.tensor([0.4, 0.8, 1.2]) + steps[:, None])
    torch.testing.assert_close(gravity, torch.tensor([0.0, 0.6, -0.8]) + steps[:, None])
    assert torch.equal(joint_pos[:, 1], 6 + 100 * steps)  # right hip pitch comes second
    assert torch.equal(joint_vel, -joint_pos)
    assert torch.equal(actions[:, 0], steps)  # the decoder's own answers, 1 and 2; before the start none


def test_memory_is_each_robots_own(seen):
    tracker = Sonic("anywhere")
    both = torch.cat((situation(0), situation(0)))
    tracker(both)
    both = torch.cat((situation(1), situation(0)))  # the second one starts anew
    tracker(both)
    gravity = seen["model_decoder.onnx"][1][:, -3:]
    last_action = seen["model_decoder.onnx"][1][:, 64 + 30 + 290 + 290 + 9 * 29]
    torch.testing.assert_close(gravity[:, 1], torch.tensor([1.6, 0.6]))
    assert last_action.tolist() == [1, 0]


def test_what_its_action_means(monkeypatch, seen):
    tracker = Sonic("anywhere")
    answer = torch.arange(29.0)[None]
    monkeypatch.setattr(tracker, "_decoder", lambda observation: answer)
    action = tracker(situation(0))["action"][0]
    # in units of the robot's own action scale it is the networks' action, in the robot's order
    for place, name in [*enumerate(FIRST), *enumerate(LAST, start=25)]:
        assert action[G1.joint_names.index(name)] == pytest.approx(place, abs=1e-4)


def test_its_robot_has_a_stronger_hip_pitch():
    robot, names = sonic_robot(), G1.joint_names
    pitch, roll = names.index("right_hip_pitch"), names.index("right_hip_roll")
    assert robot.stiffness[pitch] == robot.stiffness[roll] == G1.stiffness[roll] != G1.stiffness[pitch]
    assert robot.effort_limit[pitch] == 139
    others = [joint for joint, name in enumerate(names) if "hip_pitch" not in name]
    assert torch.equal(robot.action_scale[others], G1.action_scale[others])


def stand_in(folder: Path) -> Path:
    """Networks of the released shapes: the encoder passes on its first 64 numbers, the decoder answers zeros."""
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper, numpy_helper

    folder.mkdir()
    for name, inputs, outputs in (("model_encoder", 1762, 64), ("model_decoder", 994, 29)):
        weights = (
            np.eye(inputs, outputs, dtype=np.float32) if outputs == 64 else np.zeros((inputs, outputs), np.float32)
        )
        graph = helper.make_graph(
            [helper.make_node("MatMul", ["obs_dict", "weights"], ["out"])],
            name,
            [helper.make_tensor_value_info("obs_dict", TensorProto.FLOAT, [1, inputs])],
            [helper.make_tensor_value_info("out", TensorProto.FLOAT, [1, outputs])],
            [numpy_helper.from_array(weights, "weights")],
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        onnx.save(model, folder / f"{name}.onnx")
    return folder


@pytest.mark.parametrize("dense", [False, True])
def test_stand_in_networks_of_the_released_shapes_are_evaluated(tmp_path, dense):
    pytest.importorskip("onnxruntime")
    tracker = Sonic(stand_in(tmp_path / "sonic"))
    library = MotionLibrary.from_clips([standing_clip("a", frames=20), standing_clip("b", frames=20)], tracker.robot)
    records = evaluate(tracker, library, HORIZONS["medium"], dense=dense, observe=tracker.observe, num_threads=1)
    # its action is 0: the default pose is held, in which the robot of these clips stands
    assert records.steps.sum() > 30
    assert not records.fell.any()


def test_a_folder_without_the_networks_is_named(tmp_path):
    pytest.importorskip("onnxruntime")
    with pytest.raises(BundleError, match="model_encoder.onnx': no such file"):
        Sonic(tmp_path)
