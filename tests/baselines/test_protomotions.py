import numpy as np
import pytest
import torch
import yaml
from tensordict import TensorDict

from plat.baselines import CATALOG, ProtoMotions
from plat.errors import CheckpointError
from plat.motions import MotionLibrary
from plat.robots import G1
from plat.rotations import quat_from_rotvec
from tests.conftest import standing_clip

FRAMES = 3
INPUTS = {
    "current_state_dof_pos": "current.dof_pos",
    "current_state_anchor_rot": "current.anchor_rot",
    "current_state_root_local_ang_vel": "current.root_local_ang_vel",
    "historical_actions": "historical.processed_actions",
    "mimic_future_rot": "mimic.future_rot",
    "mimic_future_dof_pos": "mimic.future_dof_pos",
}


class StandIn:
    """Session that returns its call's number in every target, and remembers what it is fed."""

    class Entry:
        def __init__(self, name, shape):
            self.name, self.shape = name, shape

    def __init__(self, inputs=INPUTS, outputs=("actions", "joint_pos_targets")):
        self.fed: list[dict[str, np.ndarray]] = []
        self._inputs, self._outputs = inputs, outputs

    def get_inputs(self):
        return [self.Entry(name, [1]) for name in self._inputs]

    def get_outputs(self):
        return [self.Entry(name, [1, 29]) for name in self._outputs]

    def run(self, names, feed):
        assert names == ["joint_pos_targets"]
        self.fed.append(feed)
        return [np.full((1, 29), float(len(self.fed)), np.float32)]


@pytest.fixture
def made(tmp_path, monkeypatch):
    def make(session=None, **control):
        session = session or StandIn()
        model = G1.shared_model
        bodies = [model.body(index).name for index in range(1, model.nbody)]
        bodies[16:16] = ["head"]
        content = {
            "robot": {
                "joint_names": [f"{name}_joint" for name in G1.joint_names],
                "body_names": bodies,
                "anchor_body_name": "torso_link",
            },
            "motion": {"future_step_indices": [1, 2, 8]},
            "control": {"stiffness": [30.0] * 29, "damping": [2.0] * 29, **control},
            "_runtime": {"onnx_name_to_in_key": session._inputs},
        }
        (tmp_path / "unified_pipeline.yaml").write_text(yaml.safe_dump(content))
        monkeypatch.setattr("plat.baselines.protomotions.open_session", lambda path: session)
        return ProtoMotions(tmp_path), session

    return make


def situation(starting: bool = True) -> TensorDict:
    lean = quat_from_rotvec(torch.tensor([[0.2, 0.0, 0.0]]))
    upright = torch.tensor([1.0, 0.0, 0.0, 0.0])
    keypoints = upright.repeat(1, 14, 1)
    keypoints[:, G1.anchor_index] = lean
    return TensorDict(
        {
            "robot": TensorDict(
                {
                    "joint_pos": torch.zeros(1, 29),
                    "joint_vel": torch.zeros(1, 29),
                    "root_ang_vel_b": torch.tensor([[0.4, 0.8, 1.2]]),
                },
                [1],
            ),
            "state": TensorDict({"keypoint_quat_w": keypoints}, [1]),
            "tracker_reference": TensorDict(
                {
                    "joint_pos": G1.default_joint_pos.repeat(1, FRAMES, 1),
                    "joint_vel": torch.zeros(1, FRAMES, 29),
                    "root_pos_w": torch.zeros(1, FRAMES, 3),
                    "root_quat_w": lean.repeat(1, FRAMES, 1),
                },
                [1],
            ),
            "is_init": torch.tensor([[starting]]),
        },
        [1],
    )


def test_what_it_is_fed(made):
    tracker, session = made()
    tracker(situation())
    (feed,) = session.fed
    assert {name: value.shape for name, value in feed.items()} == {
        "current_state_dof_pos": (1, 29),
        "current_state_anchor_rot": (1, 4),
        "current_state_root_local_ang_vel": (1, 3),
        "historical_actions": (1, 1, 29),
        "mimic_future_rot": (1, FRAMES, 31, 4),
        "mimic_future_dof_pos": (1, FRAMES, 29),
    }
    assert feed["current_state_dof_pos"][0].tolist() == pytest.approx(G1.default_joint_pos.tolist())
    lean = [float(np.sin(0.1)), 0.0, 0.0, float(np.cos(0.1))]  # xyzw
    assert feed["current_state_anchor_rot"][0].tolist() == pytest.approx(lean, abs=1e-6)
    assert feed["mimic_future_rot"][0, 0, 0].tolist() == pytest.approx(lean, abs=1e-6)  # the root
    torso, head = feed["mimic_future_rot"][0, 0, 15], feed["mimic_future_rot"][0, 0, 16]
    assert torso.tolist() == head.tolist()
    assert tracker.ahead == (1, 2, 8)


def test_the_inputs_of_the_release(made):
    """The file of August 2026 sees orientations of the torso alone, and four frames ahead."""
    keys = ("current.anchor_rot", "current.dof_pos", "current.dof_vel", "current.root_local_ang_vel")
    keys += ("historical.processed_actions", "mimic.future_anchor_rot", "mimic.future_dof_pos", "mimic.future_dof_vel")
    session = StandIn({key.replace(".", "_"): key for key in keys})
    tracker, _ = made(session, effort_limits=None, pd_target_max_accel=None, action_ema_alpha=1.0)
    tracker(situation())
    (feed,) = session.fed
    shapes = [(1, 4), (1, 29), (1, 29), (1, 3), (1, 1, 29), (1, FRAMES, 4), (1, FRAMES, 29), (1, FRAMES, 29)]
    assert [feed[key.replace(".", "_")].shape for key in keys] == shapes
    assert feed["current_root_local_ang_vel"][0].tolist() == pytest.approx([0.4, 0.8, 1.2])
    assert not feed["historical_processed_actions"].any()  # a robot that starts has no past
    assert torch.equal(tracker.robot.effort_limit, G1.effort_limit)


def test_targets_are_its_own_and_are_remembered(made):
    tracker, session = made()
    for starting, wanted in ((True, 1.0), (False, 2.0)):
        action = tracker(situation(starting))["action"]
        targets = G1.default_joint_pos + tracker.robot.action_scale * action
        torch.testing.assert_close(targets, torch.full((1, 29), wanted))
    assert (session.fed[1]["historical_actions"] == 1.0).all()
    assert (tracker.robot.stiffness == 30.0).all()


def test_moving_average_and_bound_on_the_second_difference(made):
    tracker, _ = made(action_ema_alpha=0.75)
    values = [
        float(tracker.targets(situation(), torch.zeros(1, 29), torch.tensor([first]))[0, 0]) for first in (True, False)
    ]
    assert values == pytest.approx([1.0, 0.75 * 2 + 0.25])
    jumps = StandIn()
    jumps.run = lambda names, feed: [np.full((1, 29), {0: 0.0, 1: 0.0}.get(len(jumps.fed), 5.0), np.float32)]
    tracker, _ = made(jumps, pd_target_max_accel=0.1)
    found = []
    for number in range(4):
        found.append(float(tracker.targets(situation(), torch.zeros(1, 29), torch.tensor([number == 0]))[0, 0]))
        jumps.fed.append({})
    assert found == pytest.approx([0.0, 0.0, 0.1, 0.3])


def test_what_it_lacks_is_named(made):
    with pytest.raises(CheckpointError, match=r"reads \['mimic.ref_anchor_pos'\]"):
        made(StandIn({**INPUTS, "odometer": "mimic.ref_anchor_pos"}))
    with pytest.raises(CheckpointError, match=r"outputs \['actions'\], expected joint_pos_targets"):
        made(StandIn(outputs=("actions",)))
    with pytest.raises(CheckpointError, match="control.stiffness has 2 numbers, expected 29"):
        made(stiffness=[1.0, 2.0])


def test_it_runs_in_an_evaluation(made):
    from plat.envs.transforms import Horizon
    from plat.evaluation import Entrant

    tracker, _ = made()
    library = MotionLibrary.from_clips([standing_clip(frames=16)])
    records = Entrant.of_tracker(tracker, interface="line").evaluate(library, Horizon(10, 10), num_threads=1)
    assert len(records.failed) == 2
    assert not CATALOG["ProtoMotions"].tested
