import json
import os

import mujoco
import numpy as np
import pytest
import torch
from tensordict.nn import TensorDictModule

from plat.deploy import PolicyRunner, RobotState
from plat.errors import BundleError
from plat.export import JointTargetNetwork, export_bundle
from plat.export.onnx_file import onnx_model
from plat.modules import PlainPolicy, PlainPolicyConfig
from plat.robots import G1
from plat.runs import average_runs, register_policy
from plat.runs.policies import _KINDS
from plat.scratch import Scratch
from plat.spec.timing import Timing
from tests.export.runs import KINDS, small_policy, write_run

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxscript")
pytest.importorskip("onnxruntime")

pytestmark = pytest.mark.usefixtures("quick_exports")

_WRITTEN: dict[bytes, bytes] = {}


@pytest.fixture
def written_once(monkeypatch):
    """For tests of what is around the network: torch writes one of the same weights once, which takes seconds."""

    def model(network, num_features, metadata):
        weights = b"".join(value.numpy().tobytes() for value in network.state_dict().values())
        if weights not in _WRITTEN:
            _WRITTEN[weights] = onnx_model(network, num_features, {}).SerializeToString()
        written = onnx.load_from_string(_WRITTEN[weights])
        onnx.helper.set_model_props(written, dict(metadata))
        return written

    monkeypatch.setattr("plat.export.bundle.onnx_model", model)


class Keyframe:
    def __init__(self, root_pos, root_quat, joint_pos):
        self.root_pos, self.root_quat, self.joint_pos = map(np.array, (root_pos, root_quat, joint_pos))


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_policy(tmp_path, kind):
    policy = small_policy(kind)
    check = export_bundle(write_run(tmp_path / "run", policy), tmp_path / "bundle")
    assert 0 < check.max_difference < 1e-5
    names = sorted(path.name for path in (tmp_path / "bundle").iterdir())
    assert names == ["README.md", "bundle.json", "example.json", "policy.onnx", "scene.xml"]
    example = json.loads((tmp_path / "bundle" / "example.json").read_text())
    expected = JointTargetNetwork(policy)(torch.tensor(example["observation"]))
    np.testing.assert_allclose(example["joint_position_target"], expected.detach(), atol=1e-6)
    runner = PolicyRunner(tmp_path / "bundle")
    runner.reset(runner.robot.default_joint_pos + runner.robot.action_scale * example["last_action"])
    state = RobotState(**{name: np.array(values) for name, values in example["state"].items()})
    target = runner(state, Keyframe(**example["keyframe"]), example["steps_left"])
    np.testing.assert_allclose(target, example["joint_position_target"], atol=1e-5)


def test_the_same_run_gives_the_same_files(tmp_path):
    run = write_run(tmp_path / "run", small_policy("residual_latent"))
    for name in ("a", "b"):
        export_bundle(run, tmp_path / name)
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def test_the_physics_steps_of_the_scene_are_those_of_the_training(tmp_path):
    """A robot's file has a time step of its own, of which a control step may be no multiple."""
    policy = PlainPolicy(G1, PlainPolicyConfig(backbone=(8,), decoder=(8,), timing=Timing(control_dt=0.012)))
    export_bundle(write_run(tmp_path / "run", policy), tmp_path / "bundle")
    scene = mujoco.MjModel.from_xml_path(str(tmp_path / "bundle" / "scene.xml"))
    assert scene.opt.timestep == pytest.approx(0.003)


def test_the_card_of_an_average_has_the_motions_of_all_parts(tmp_path, written_once):
    policy = small_policy("plain")
    write_run(tmp_path / "a", policy, motions=["bandai.npz"]), write_run(tmp_path / "b", policy, motions=["asap.npz"])
    export_bundle(average_runs([tmp_path / "a", tmp_path / "b"], tmp_path / "mean").folder, tmp_path / "bundle")
    card = (tmp_path / "bundle" / "README.md").read_text()
    assert "| `bandai.npz` |" in card
    assert "| `asap.npz` |" in card
    assert "The strictest of these licenses, if the names of the files are right: CC BY-NC 4.0." in card


def test_a_renamed_run_keeps_its_scores(tmp_path, written_once):
    run = write_run(tmp_path / "run", small_policy("plain"))
    (run / "evaluation.csv").write_text("policy,horizon,metric,value,low,high\nrun,long,tks,99.5,99.25,99.75\n")
    export_bundle(run.rename(tmp_path / "renamed"), tmp_path / "bundle")
    assert "| long | 99.5 (99.2-99.8) |" in (tmp_path / "bundle" / "README.md").read_text()


class OwnStudent(PlainPolicy):
    """Of a user."""


class Threshold(torch.nn.Module):
    def forward(self, goal: torch.Tensor) -> torch.Tensor:
        return (goal > 0).float()


class OwnPolicy(torch.nn.Module):
    """Of a user: no part of plat's, no normalizer."""

    def __init__(self, robot, config=None):
        super().__init__()
        self.robot, self.config = robot, config or PlainPolicyConfig()

    def deployed(self):
        return TensorDictModule(Threshold(), [("goal", "joint_pos")], ["action"])


@pytest.mark.parametrize("policy_class", [OwnStudent, OwnPolicy])
def test_a_registered_class_is_exported(tmp_path, monkeypatch, policy_class):
    monkeypatch.setattr("plat.runs.policies._KINDS", dict(_KINDS))
    register_policy("own", policy_class, PlainPolicyConfig)
    check = export_bundle(write_run(tmp_path / "run", policy_class(G1)), tmp_path / "bundle")
    assert check.max_difference < 1e-4
    assert json.loads((tmp_path / "bundle" / "bundle.json").read_text())["policy"]["kind"] == "own"


def test_an_expert_is_refused(tmp_path):
    run = write_run(tmp_path / "run", small_policy("expert"))
    with pytest.raises(BundleError, match="holds an expert, which follows dense reference motion"):
        export_bundle(run, tmp_path / "bundle")


def test_a_folder_that_is_there_is_not_touched(tmp_path):
    run = write_run(tmp_path / "run", small_policy("plain"))
    (tmp_path / "bundle").mkdir()
    with pytest.raises(BundleError, match="bundle' is there already"):
        export_bundle(run, tmp_path / "bundle")


def test_a_network_that_differs_is_not_let_through(tmp_path, monkeypatch, written_once):
    run = write_run(tmp_path / "run", small_policy("plain"))
    monkeypatch.setattr("plat.export.bundle.TOLERANCE", 1e-12)
    with pytest.raises(BundleError, match="exported and torch policy differ by .* rad, expected at most 1e-12"):
        export_bundle(run, tmp_path / "bundle")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_nothing_is_left_behind_when_the_disk_is_full(tmp_path, monkeypatch, written_once):
    run = write_run(tmp_path / "run", small_policy("plain"))

    def full(*_: object) -> str:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("plat.export.bundle.model_card", full)
    with pytest.raises(BundleError, match=r"bundle' could not be written \(.*No space left"):
        export_bundle(run, tmp_path / "bundle")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_what_a_killed_export_left_goes_with_the_next(tmp_path, written_once):
    run = write_run(tmp_path / "run", small_policy("plain"))
    killed = Scratch(".bundle-", tmp_path)
    (killed.path / "bundle").mkdir()
    killed._file.close()  # as the end of its process does
    os.utime(killed.path / ".lock", (0, 0))
    export_bundle(run, tmp_path / "bundle")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bundle", "run"]
    assert not (tmp_path / "bundle" / ".lock").exists()
