import pytest
import torch
from tensordict import TensorDict
from torchrl.collectors import Collector

from plat.collectors import LOOKUP_KEYS, ExpertLabels, MixedPolicy, dagger_buffer
from plat.collectors.storage import DeviceStorage
from plat.envs import make_keyframe_env
from plat.errors import ActionError
from plat.modules import STUDENT_KEYS, Expert, ExpertConfig, LatentPolicy
from plat.motions import MotionLibrary
from plat.robots import G1
from tests.modules.policies.test_student import SMALL


def labeller() -> tuple[torch.nn.Module, ExpertLabels]:
    expert = Expert(G1, ExpertConfig(hidden=(16,))).deployed("dense_goal", out_key="expert_action")
    return expert, ExpertLabels(expert, STUDENT_KEYS, "float32")


def test_labels_are_the_experts_actions_at_visited_states(library):
    expert, labels = labeller()
    rollout = make_keyframe_env(library, 4).rollout(3, break_when_any_done=False)
    states = labels(rollout)
    assert states.shape == (12,)
    expected = expert(rollout.select("robot", "dense_goal").reshape(-1))["expert_action"]
    assert torch.equal(states["expert_action"], expected)


def test_labels_in_half_precision_are_close(library):
    expert, labels = labeller()
    rollout = make_keyframe_env(library, 4).rollout(3, break_when_any_done=False)
    exact, half = (each(rollout)["expert_action"] for each in (labels, ExpertLabels(expert, STUDENT_KEYS, "bfloat16")))
    assert half.dtype == torch.float32
    assert not torch.equal(half, exact)
    torch.testing.assert_close(half, exact, atol=0.02, rtol=0.02)


def test_only_what_is_needed_is_kept(library):
    _, labels = labeller()
    states = labels(make_keyframe_env(library, 4).rollout(3, break_when_any_done=False))
    assert set(states.keys(True, True)) == {*STUDENT_KEYS, *LOOKUP_KEYS, "expert_action"}
    # a state takes less than a kilobyte; its dense goals would take sixteen
    assert sum(value[0].numel() * value.element_size() for value in states.values(True, True)) < 1000


def test_mixing(library):
    expert, _ = labeller()
    student = LatentPolicy(G1, SMALL)
    state = make_keyframe_env(library, 200).reset()
    label = expert(state.clone())["expert_action"]
    own = student.deployed()(state.clone())["action"]
    for share, low, high in ((0.0, 0.0, 0.0), (0.5, 0.35, 0.65), (1.0, 1.0, 1.0)):
        action = MixedPolicy(student.deployed(), expert, share)(state.clone())["action"]
        by_expert = (action == label).all(-1)
        assert torch.equal(action[~by_expert], own[~by_expert])
        assert low <= by_expert.float().mean() <= high


def test_share_can_be_lowered_while_training(library):
    expert, _ = labeller()
    policy = MixedPolicy(LatentPolicy(G1, SMALL).deployed(), expert, 1.0)
    policy.expert_share.fill_(0.0)
    state = make_keyframe_env(library, 4).reset()
    assert torch.equal(policy(state.clone())["action"], policy.student(state.clone())["action"])


def test_collector_and_buffer_work_together(library):
    expert, labels = labeller()
    policy = MixedPolicy(LatentPolicy(G1, SMALL).sampled(), expert, 0.5)
    collector = Collector(
        make_keyframe_env(library, 8),
        policy,
        frames_per_batch=32,
        total_frames=96,
        postproc=labels,
        track_traj_ids=False,
        trust_policy=True,
        auto_register_policy_transforms=False,
    )
    buffer = dagger_buffer(library, capacity=64, batch_size=16, stride=5)
    for states in collector:
        assert states.shape == (32,)
        buffer.extend(states)
    assert len(buffer) == 64  # a ring: the oldest have given way
    batch = buffer.sample()
    assert batch["privileged_goal", "frames"].shape[0] == 16
    assert batch["expert_action"].shape == (16, 29)
    collector.shutdown()


def test_buffer_survives_a_checkpoint(library, tmp_path):
    _, labels = labeller()
    states = labels(make_keyframe_env(library, 8).rollout(4, break_when_any_done=False))
    buffer = dagger_buffer(library, capacity=50, batch_size=16)
    buffer.extend(states)
    torch.save(buffer.state_dict(), tmp_path / "buffer.pt")
    other = dagger_buffer(library, capacity=50, batch_size=16)
    other.load_state_dict(torch.load(tmp_path / "buffer.pt", weights_only=True))
    assert len(other) == len(states)
    assert torch.equal(other[:]["expert_action"], buffer[:]["expert_action"])
    other.extend(states)
    assert len(other) == 50


@pytest.mark.parametrize("entry", [("robot", "joint_vel"), ("dense_goal", "joint_pos")])
def test_states_that_are_not_finite_are_not_labeled(library, entry):
    _, labels = labeller()
    rollout = make_keyframe_env(library, 4).rollout(3, break_when_any_done=False)
    rollout[entry].view(-1)[50] = float("nan")
    with pytest.raises(ActionError, match=r"rollout: .* holds NaN or infinity; nothing of it is kept"):
        labels(rollout)


def test_what_is_loaded_is_on_the_device_of_the_buffer(library):
    buffer = dagger_buffer(library, capacity=50, batch_size=16)
    buffer.extend(TensorDict({"robot": {"joint_pos": torch.zeros(20, 29)}}, [20]))
    # "meta" stands for a GPU: a checkpoint is read to the CPU
    resumed = DeviceStorage(50, device="meta")
    resumed.load_state_dict(buffer.storage.state_dict())
    assert len(resumed) == 20
    assert resumed[:]["robot", "joint_pos"].device.type == "meta"


def test_goals_are_gathered_on_the_device_of_the_buffer(library, monkeypatch):
    moved = []
    monkeypatch.setattr(MotionLibrary, "to", lambda self, device: moved.append(device) or self)
    dagger_buffer(library, capacity=50, batch_size=16, device="cpu")
    assert moved == ["cpu"]  # a library on the CPU failed at the first sample of states on a GPU


def test_padding_of_trajectories_is_not_labeled(library):
    _, labels = labeller()
    collector = Collector(
        make_keyframe_env(library, 3),
        LatentPolicy(G1, SMALL).sampled(),
        frames_per_batch=90,
        total_frames=90,
        split_trajs=True,
    )
    padded = next(iter(collector))
    collector.shutdown()
    states = labels(padded)
    assert not padded["collector", "mask"].all()
    assert states.shape == (90,)
    torch.testing.assert_close(states["robot", "gravity_b"].norm(dim=-1), torch.ones(90), atol=0.2, rtol=0)
