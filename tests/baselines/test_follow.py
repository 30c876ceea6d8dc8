import pytest
import torch

from plat.baselines import Twist2, Wbc, follow
from plat.motions import MotionClip, MotionLibrary, load_motions
from plat.robots import G1


def standing(seconds: float) -> MotionClip:
    qpos = torch.as_tensor(G1.default_qpos).expand(round(seconds * 50) + 1, -1).numpy()
    return MotionClip(f"standing_{seconds}", qpos, 50.0)


def hold(tensordict):
    """Joint targets are those of the reference."""
    target = tensordict["tracker_reference", "joint_pos"]
    return tensordict.set("action", (target - G1.default_joint_pos) / G1.action_scale)


def collapse(tensordict):
    """Knees give way."""
    action = torch.zeros(*tensordict.shape, 29)
    action[:, [G1.joint_names.index(f"{side}_knee") for side in ("left", "right")]] = 2.0
    return tensordict.set("action", action)


def test_who_stands_still_follows_a_still_motion():
    library = MotionLibrary.from_clips([standing(0.6), standing(0.3)])
    assert follow(hold, library, num_threads=1).tolist() == [1.0, 1.0]


def test_who_falls_is_told_when():
    library = MotionLibrary.from_clips([standing(2.0), standing(0.1)])
    share = follow(collapse, library, num_threads=1)
    assert 0.0 < share[0] < 0.9
    assert share[1] == 1.0  # over before it fell


@pytest.mark.parametrize(("tracker", "file"), [(Twist2, "twist2/twist2_1017_20k"), (Wbc, "wbc/policy_066ab15")])
def test_released_trackers_follow_real_motion(shared_data, tracker, file):
    pytest.importorskip("onnxruntime")
    policy = tracker(shared_data / "baselines" / f"{file}.onnx")
    clips = [clip for clip in load_motions(shared_data / "motions" / "bandai_val.npz") if "walk_normal" in clip.name]
    library = MotionLibrary.from_clips(clips[:4], policy.robot)
    assert (follow(policy, library) == 1).all()
