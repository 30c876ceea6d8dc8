import csv
from pathlib import Path

import pytest
import torch

from examples.teacher import TeacherExample, main
from plat.baselines import Wbc
from plat.collectors import ExpertLabels, MixedPolicy, rollouts
from plat.envs import make_keyframe_env
from plat.modules import STUDENT_KEYS, LatentPolicy, Teacher
from plat.robots import G1
from plat.runs import load_policy
from tests.modules.policies.test_student import SMALL
from tests.recipes.runs import write_motions

pytest.importorskip("onnxruntime")
onnx = pytest.importorskip("onnx")


@pytest.fixture(scope="module")
def network(tmp_path_factory) -> Path:
    """A network of wbc's widths that answers with half of its last action, and 0.1."""
    from onnx import TensorProto, helper

    shapes = (("seen", 132), ("action", 29))
    seen, action = (helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", width]) for name, width in shapes)
    constants = {"start": (7, [103]), "end": (7, [132]), "axis": (7, [1])}
    values = [helper.make_tensor(name, kind, [1], value) for name, (kind, value) in constants.items()]
    values += [helper.make_tensor(name, 1, [], [value]) for name, value in (("half", 0.5), ("tenth", 0.1))]
    nodes = [
        helper.make_node("Slice", ["seen", "start", "end", "axis"], ["last"]),
        helper.make_node("Mul", ["last", "half"], ["halved"]),
        helper.make_node("Add", ["halved", "tenth"], ["action"]),
    ]
    graph = helper.make_graph(nodes, "stand-in", [seen], [action], values)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path = tmp_path_factory.mktemp("wbc") / "tracker.onnx"
    onnx.save(model, path)
    return path


def test_a_released_tracker_is_a_teacher(network):
    assert isinstance(Wbc(network), Teacher)


def test_a_trackers_labels_follow_its_own_past(network, library):
    teacher = Wbc(network)
    env = make_keyframe_env(library, 2, dense_goals={}, transforms=teacher.references(library))
    student = LatentPolicy(G1, SMALL)
    policy = MixedPolicy(student.sampled(), teacher.labels(), keep_labels=True)
    rollout = next(rollouts(env, policy, steps=3))
    target = G1.default_joint_pos + G1.action_scale * rollout["expert_action"]
    raw = (target - rollout["tracker_reference", "joint_pos"]) / teacher._scale
    before = torch.cat((torch.zeros(2, 1, 29), raw[:, :-1]), 1) * ~rollout["is_init"]
    torch.testing.assert_close(raw, 0.5 * before + 0.1, atol=1e-4, rtol=0)
    assert not torch.allclose(rollout["action"], rollout["expert_action"])  # the student has acted
    states = ExpertLabels(None, STUDENT_KEYS)(rollout)
    assert torch.equal(states["expert_action"], rollout["expert_action"].flatten(0, 1))


def test_the_example_distills_a_student(network, tmp_path):
    example = TeacherExample(
        network, (write_motions(tmp_path),), tmp_path / "run", steps=64, num_envs=4, teacher_share=1.0, policy=SMALL
    )
    torch.manual_seed(0)
    main(example)
    with (tmp_path / "run" / "metrics.csv").open() as file:
        errors = [float(row["prior_error"]) for row in csv.DictReader(file)]
    assert len(errors) == 2
    assert errors[-1] < errors[0]
    assert load_policy(tmp_path / "run").config == SMALL
