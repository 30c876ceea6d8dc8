import json
import shutil
import warnings

import numpy as np
import pytest
import torch

from plat.deploy import ObservationBuilder, PolicyRunner
from plat.errors import ActionError, BundleError, StateError
from plat.export import JointTargetNetwork
from plat.robots import G1
from plat.runs import load_policy
from tests.deploy.robots import SomePose, random_qpos, state_at
from tests.deploy.test_import import HEAVY
from tests.deploy.test_import import run as run_program


@pytest.fixture
def copy(bundle, tmp_path):
    """The bundle, to be spoiled."""
    return shutil.copytree(bundle, tmp_path / "bundle")


def test_agrees_with_torch_and_remembers_its_last_action(bundle, run):
    runner, network = PolicyRunner(bundle, G1.joint_names), JointTargetNetwork(load_policy(run))
    observe = ObservationBuilder(runner.robot, runner.bundle.max_steps)
    last_action = np.zeros(29)
    for steps_left, (now, goal) in zip((30, 29, 1), random_qpos(6).reshape(3, 2, -1), strict=True):
        state, pose = state_at(now), SomePose(goal)
        observation = torch.from_numpy(observe(state, pose, steps_left, last_action))
        expected = network(observation).detach().numpy()
        np.testing.assert_allclose(runner(state, pose, steps_left), expected, atol=1e-5)
        last_action = (expected - G1.default_joint_pos.numpy()) / G1.action_scale.numpy()


def test_reset_forgets_the_last_action(bundle):
    runner, (now, goal) = PolicyRunner(bundle), random_qpos(2)
    first = runner(state_at(now), SomePose(goal), 10)
    assert not np.allclose(first, runner(state_at(now), SomePose(goal), 10), atol=1e-4)
    runner.reset()
    np.testing.assert_array_equal(first, runner(state_at(now), SomePose(goal), 10))
    runner.reset(runner.robot.default_joint_pos + 0.3)
    assert not np.allclose(first, runner(state_at(now), SomePose(goal), 10), atol=1e-4)


def test_a_time_in_seconds_and_the_gains(bundle):
    by_steps, by_time, (now, goal) = PolicyRunner(bundle), PolicyRunner(bundle), random_qpos(2)
    command = by_time.step(state_at(now), SomePose(goal), time_left=0.5)
    np.testing.assert_array_equal(command.position, by_steps(state_at(now), SomePose(goal), 25))
    np.testing.assert_allclose(command.stiffness, G1.stiffness)
    np.testing.assert_allclose(command.damping, G1.damping)
    for gains in command[1:]:
        gains *= 0.5  # a careful program softens them, for this step
    again = by_time.step(state_at(now), SomePose(goal), time_left=0.5)
    np.testing.assert_allclose(again.stiffness, G1.stiffness)
    np.testing.assert_allclose(again.damping, G1.damping)


def test_a_clock_that_counts_down_meets_whole_steps(bundle, monkeypatch):
    """(5.98 - 5.92) / 0.02 is 3.000000000000025, which is in no arrival window of 3 steps."""
    runner, (now, goal) = PolicyRunner(bundle), random_qpos(2)
    observe, seen = runner._observe, []
    monkeypatch.setattr(runner, "_observe", lambda *given: seen.append(given[2]) or observe(*given))
    for step in range(100, 300):
        runner.step(state_at(now), SomePose(goal), (step + 3) * 0.02 - step * 0.02)
    assert set(seen) == {3}
    runner.step(state_at(now), SomePose(goal), 0.05)
    assert seen[-1] == pytest.approx(2.5)


@pytest.mark.parametrize("number", [np.array, np.float32, torch.tensor], ids=["array", "float32", "tensor"])
def test_numbers_of_other_libraries_are_times(bundle, number):
    plain, other, (now, goal) = PolicyRunner(bundle), PolicyRunner(bundle), random_qpos(2)
    expected = plain(state_at(now), SomePose(goal), 25)
    np.testing.assert_array_equal(other(state_at(now), SomePose(goal), number(25)), expected)
    expected = plain.step(state_at(now), SomePose(goal), 0.5).position
    np.testing.assert_array_equal(other.step(state_at(now), SomePose(goal), number(0.5)).position, expected)


@pytest.mark.parametrize("time_left", [0.0, -0.02, 1.02, float("nan"), 10**400, "soon", None])
def test_a_time_that_the_policy_was_not_made_for(bundle, time_left):
    runner, (now, goal) = PolicyRunner(bundle), random_qpos(2)
    with pytest.raises(StateError, match=r"time to the keyframe is .*, expected more than 0 and at most 50 \(1 s\)"):
        runner.step(state_at(now), SomePose(goal), time_left)


@pytest.mark.parametrize("control_dt", [0.01, float("nan"), 10**400, "0.02"])
def test_a_control_step_that_is_another(bundle, control_dt):
    with pytest.raises(BundleError, match="control step of 0.02 s, not the .* s of this robot"):
        PolicyRunner(bundle, control_dt=control_dt)


def test_a_state_that_is_not_finite(bundle):
    runner, (now, goal) = PolicyRunner(bundle), random_qpos(2)
    now[10] = np.nan
    with pytest.raises(StateError, match=r"robot state: joint_pos\[3\] is nan, expected a finite number"):
        runner(state_at(now), SomePose(goal), 10)


@pytest.mark.parametrize("field", ["joint_pos", "joint_vel", "root_pos_w"])
def test_a_state_that_no_robot_has(bundle, field):
    runner, (now, goal) = PolicyRunner(bundle), random_qpos(2)
    state = state_at(now)
    getattr(state, field)[0] = 1e300
    with pytest.raises(StateError, match=r"observation: holds \S+e\+\d+, expected numbers that a robot measures"):
        runner(state, SomePose(goal), 10)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (np.full(29, np.nan), r"joint_target\[0\] is nan, expected a finite number"),
        (np.zeros(3), r"joint_target has shape \(3,\), expected \(29,\)"),
        (np.zeros((29, 1)), r"joint_target has shape \(29, 1\), expected \(29,\)"),
        ([10**400] * 29, "joint_target is .*, expected 29 numbers"),
        ("rest", "joint_target is 'rest', expected 29 numbers"),
    ],
)
def test_a_last_target_that_no_motor_had(bundle, target, message):
    with pytest.raises(StateError, match=message):
        PolicyRunner(bundle).reset(target)


OLD = pytest.warns(UserWarning, match="bundle.json' does not hold its network's hash: export it again")


def change_network(folder, change):
    """Change the network of a bundle, as one that was exported before bundles held its hash."""
    import onnx

    model = onnx.load(folder / "policy.onnx")
    change(model)
    onnx.save(model, folder / "policy.onnx")
    content = json.loads((folder / "bundle.json").read_text())
    del content["network_sha256"]
    (folder / "bundle.json").write_text(json.dumps(content))


def multiply_outputs(model, factor):
    """Multiply the joint position targets by a number."""
    import onnx

    graph = model.graph
    last = next(node for node in graph.node if node.output[0] == "joint_position_target")
    last.output[0] = "unscaled"
    graph.initializer.append(onnx.helper.make_tensor("factor", onnx.TensorProto.FLOAT, (), [factor]))
    graph.node.append(onnx.helper.make_node("Mul", ["unscaled", "factor"], ["joint_position_target"]))


@pytest.mark.parametrize("factor", [float("nan"), float("inf")])
def test_targets_that_are_not_finite_are_neither_returned_nor_remembered(copy, bundle, factor):
    import onnxruntime

    change_network(copy, lambda model: multiply_outputs(model, factor))
    with OLD:
        broken = PolicyRunner(copy)
    good, poses = PolicyRunner(bundle), random_qpos(4)
    first = good(state_at(poses[0]), SomePose(poses[1]), 10)
    broken.reset(first)
    with pytest.raises(ActionError, match=r"target of joint 'left_hip_pitch' is -?(nan|inf), expected a finite angle"):
        broken(state_at(poses[2]), SomePose(poses[3]), 10)
    with pytest.raises(ActionError, match="hold the last targets"):
        broken.step(state_at(poses[2]), SomePose(poses[3]), 0.2)
    # its network mended, it goes on from the last target that was sent
    broken._session = onnxruntime.InferenceSession(str(bundle / "policy.onnx"))
    again = broken(state_at(poses[2]), SomePose(poses[3]), 9)
    np.testing.assert_array_equal(again, good(state_at(poses[2]), SomePose(poses[3]), 9))


def test_a_network_that_was_changed(copy):
    import onnx

    model = onnx.load(copy / "policy.onnx")
    weights = model.graph.initializer[0]
    weights.raw_data = bytes([weights.raw_data[0] ^ 1]) + weights.raw_data[1:]
    onnx.save(model, copy / "policy.onnx")
    message = r"policy.onnx' has the SHA-256 .*, bundle.json was written with .*: the network was changed"
    with pytest.raises(BundleError, match=message):
        PolicyRunner(copy)


def test_a_network_that_does_not_run(copy):
    import onnx

    def gather_beyond_the_end(model):
        graph = model.graph
        last = next(node for node in graph.node if node.output[0] == "joint_position_target")
        last.output[0] = "whole"
        graph.initializer.append(onnx.helper.make_tensor("columns", onnx.TensorProto.INT64, (29,), [99] * 29))
        graph.node.append(onnx.helper.make_node("Gather", ["whole", "columns"], ["joint_position_target"], axis=1))

    change_network(copy, gather_beyond_the_end)
    with OLD, pytest.raises(BundleError, match=r"policy.onnx': the network does not run \(.*\)$"):
        PolicyRunner(copy)


def test_a_network_that_asks_for_terabytes(copy):
    import onnx

    def add_a_maximum_of_zeros(model):
        graph = model.graph
        last = next(node for node in graph.node if node.output[0] == "joint_position_target")
        last.output[0] = "whole"
        graph.initializer.append(onnx.helper.make_tensor("shape", onnx.TensorProto.INT64, (1,), [10**12]))
        for operation, inputs, output, more in (
            ("ConstantOfShape", ["shape"], "zeros", {}),
            ("ReduceMax", ["zeros"], "zero", {"keepdims": 0}),
            ("Add", ["whole", "zero"], "joint_position_target", {}),
        ):
            graph.node.append(onnx.helper.make_node(operation, inputs, [output], **more))

    change_network(copy, add_a_maximum_of_zeros)
    # onnxruntime 1.23 finds out when it folds constants, before there is anything to run
    told = r"policy.onnx': (the network does not run \(.*memory.*|not a readable .onnx file \(.*bad_alloc.*)\)$"
    with warnings.catch_warnings(action="ignore"), pytest.raises(BundleError, match=told):
        PolicyRunner(copy)


def test_either_of_the_two_copies_of_the_metadata_is_enough(copy):
    PolicyRunner(copy / "policy.onnx")
    change_network(copy, lambda model: model.ClearField("metadata_props"))
    with OLD:
        PolicyRunner(copy)
    (copy / "bundle.json").unlink()
    with pytest.raises(BundleError, match=r"policy.onnx': no metadata in it and no bundle.json beside it"):
        PolicyRunner(copy)


def test_the_network_alone_is_enough(copy):
    (copy / "bundle.json").unlink()
    assert PolicyRunner(copy).bundle.training.run == "plat"


def test_files_of_two_exports(copy):
    content = json.loads((copy / "bundle.json").read_text())
    content["training"]["run"] = "other"
    (copy / "bundle.json").write_text(json.dumps(content))
    with pytest.raises(BundleError, match="bundle.json' differs from the metadata in .*policy.onnx'"):
        PolicyRunner(copy)


def test_of_another_version(copy):
    text = (copy / "bundle.json").read_text()
    (copy / "bundle.json").write_text(text.replace('"version": 1', '"version": 2'))
    with pytest.raises(BundleError, match="bundle.json': version: is 2, this plat reads up to 1: update plat"):
        PolicyRunner(copy)


def test_a_network_of_other_widths(copy):
    def rename(model):
        model.graph.output[0].name = model.graph.node[-1].output[0] = "action"
        model.ClearField("metadata_props")

    change_network(copy, rename)
    with OLD, pytest.raises(BundleError, match=r"policy.onnx': input and output .*'action', 29.*, expected "):
        PolicyRunner(copy)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (G1.joint_names[:-1], "29 joints in the bundle, 28 on this robot"),
        (("spine", *G1.joint_names[1:]), "joint 0 is 'left_hip_pitch' in the bundle and 'spine' on this robot"),
        (G1.joint_names[::-1], "joint 0 is 'left_hip_pitch' in the bundle and 'right_wrist_yaw' on this robot"),
    ],
)
def test_another_robot(bundle, names, message):
    with pytest.raises(BundleError, match=message):
        PolicyRunner(bundle, names)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nowhere", "bundle .*nowhere': no such folder, expected a folder; plat export RUN --out FOLDER writes one"),
        ("nowhere.onnx", "ONNX policy .*nowhere.onnx': no such file$"),
        ("n" * 300, "no such folder"),
        ("run", "bundle .*run': holds no policy.onnx, expected a folder; plat export RUN --out FOLDER writes one"),
        ("run/config.json", "bundle .*config.json': is a file, expected a folder"),
    ],
)
def test_a_bundle_that_is_not_there(tmp_path, name, message):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.json").write_text("{}")
    with pytest.raises(BundleError, match=message):
        PolicyRunner(tmp_path / name)


def test_without_torch_and_mujoco(bundle):
    """The worked example, in a process that has numpy and onnxruntime only."""
    program = f"""
import json
from types import SimpleNamespace
import numpy as np
from plat.deploy import PolicyRunner, RobotState
example = json.load(open({str(bundle / "example.json")!r}))
runner = PolicyRunner({str(bundle)!r})
runner.reset(runner.robot.default_joint_pos + runner.robot.action_scale * example["last_action"])
state = RobotState(**{{name: np.array(values) for name, values in example["state"].items()}})
keyframe = SimpleNamespace(**{{name: np.array(values) for name, values in example["keyframe"].items()}})
target = runner(state, keyframe, example["steps_left"])
print(abs(target - example["joint_position_target"]).max())
"""
    result = run_program(program, HEAVY)
    assert result.returncode == 0, result.stderr
    assert float(result.stdout) < 1e-5


def test_without_onnxruntime(bundle):
    program = f"import plat.deploy; plat.deploy.PolicyRunner({str(bundle)!r})"
    result = run_program(program, ("onnxruntime",))
    assert "BundleError: ONNX policies need: pip install onnxruntime" in result.stderr
