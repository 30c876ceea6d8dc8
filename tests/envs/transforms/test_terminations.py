import math

import pytest
import torch
from tensordict import TensorDict

from plat.envs.transforms import KeyframeTermination, TrackingTermination
from plat.robots import G1
from plat.rotations import quat_from_rotvec, quat_multiply

ANKLE, WRIST, ELBOW = (G1.keypoints.index(f"left_{part}_link") for part in ("ankle_roll", "wrist_yaw", "elbow"))
ANCHOR, ROOT = G1.anchor_index, 0


def step(in_window: bool = True) -> TensorDict:
    pos = torch.randn(1, 14, 3)
    quat = quat_from_rotvec(torch.tensor([0.1, 0.2, 0.3])).expand(1, 14, 4).clone()
    poses = {"keypoint_pos_w": pos, "keypoint_quat_w": quat}
    flags = {key: torch.zeros(1, 1, dtype=torch.bool) for key in ("done", "terminated", "truncated")}
    return TensorDict(
        {
            "state": TensorDict(poses, [1]).clone(),
            "reference": TensorDict(poses, [1]).clone(),
            "command": {"in_window": torch.tensor([[in_window]])},
            **flags,
        },
        [1],
    )


def lift(after: TensorDict, keypoint: int, height: float) -> TensorDict:
    after["state", "keypoint_pos_w"][:, keypoint, 2] += height
    return after


def tilt(after: TensorDict, keypoint: int, rotvec: list[float]) -> TensorDict:
    turn = quat_from_rotvec(torch.tensor(rotvec))
    quat = after["state", "keypoint_quat_w"]
    quat[:, keypoint] = quat_multiply(turn.expand(1, 4), quat[:, keypoint])
    return after


def terminated(transform, after: TensorDict) -> bool:
    out = transform._step(TensorDict({}, [1]), after)
    assert out["done"] == out["terminated"]
    return bool(out["terminated"])


@pytest.mark.parametrize("keypoint", [ANCHOR, ANKLE, WRIST])
@pytest.mark.parametrize("sign", [1, -1])
def test_heights_that_end_dense_tracking(keypoint, sign):
    assert not terminated(TrackingTermination(G1), lift(step(), keypoint, sign * 0.24))
    assert terminated(TrackingTermination(G1), lift(step(), keypoint, sign * 0.26))


def test_elbows_and_places_do_not_end_it():
    assert not terminated(TrackingTermination(G1), lift(step(), ELBOW, 0.5))
    after = step()
    after["state", "keypoint_pos_w"][..., :2] += 3.0
    assert not terminated(TrackingTermination(G1), after)


def test_anchor_tilt_ends_dense_tracking():
    upright = step()
    for group in ("state", "reference"):
        upright[group, "keypoint_quat_w"] = torch.tensor([1.0, 0, 0, 0]).expand(1, 14, 4).clone()
    for angle, expected in ((math.acos(0.25), False), (math.acos(0.15), True)):
        assert terminated(TrackingTermination(G1), tilt(upright.clone(), ANCHOR, [angle, 0, 0])) == expected
    # turning about the vertical is no tilt
    assert not terminated(TrackingTermination(G1), tilt(upright.clone(), ANCHOR, [0, 0, 2.0]))


@pytest.mark.parametrize("keypoint", [ANCHOR, ANKLE, WRIST])
def test_window_asks_for_the_pose(keypoint):
    assert not terminated(KeyframeTermination(G1), lift(step(), keypoint, 0.24))
    assert terminated(KeyframeTermination(G1), lift(step(), keypoint, 0.26))
    assert not terminated(KeyframeTermination(G1), lift(step(in_window=False), keypoint, 0.26))


def test_window_asks_for_the_anchors_orientation():
    assert not terminated(KeyframeTermination(G1), tilt(step(), ANCHOR, [0, 0, 0.98]))
    assert terminated(KeyframeTermination(G1), tilt(step(), ANCHOR, [0, 0, 1.02]))
    assert not terminated(KeyframeTermination(G1), tilt(step(in_window=False), ANCHOR, [0, 0, 1.02]))


def test_between_keyframes_only_a_fall_counts():
    assert terminated(KeyframeTermination(G1), lift(step(in_window=False), ROOT, -0.26))
    assert not terminated(KeyframeTermination(G1), lift(step(in_window=False), ROOT, -0.24))
    lying = step(in_window=False)
    for group in ("state", "reference"):
        lying[group, "keypoint_quat_w"] = torch.tensor([1.0, 0, 0, 0]).expand(1, 14, 4).clone()
    assert terminated(KeyframeTermination(G1), tilt(lying, ROOT, [0, math.pi / 2, 0]))


@pytest.mark.parametrize("kind", [TrackingTermination, KeyframeTermination])
def test_displacement_ends_an_episode_where_training_asks_for_it(kind):
    def moved(distance: float) -> TensorDict:
        after = step(in_window=False)
        after["state", "keypoint_pos_w"][:, :, :2] += distance * torch.tensor([0.6, -0.8])
        return after

    assert terminated(kind(G1, max_displacement=0.5), moved(0.51))
    assert not terminated(kind(G1, max_displacement=0.5), moved(0.49))
    assert not terminated(kind(G1), moved(5.0))


@pytest.mark.parametrize(("place", "in_window", "ends"), [(1, True, True), (1, False, False), (0, True, False)])
def test_a_command_that_begins_where_the_place_was_open_is_measured_at_its_arrival(place, in_window, ends):
    after = step(in_window=in_window)
    after["state", "keypoint_pos_w"][:, :, 0] += 1.0
    after["command", "parts"] = torch.ones(1, 29 + 14 + 3)
    after["command", "parts"][:, -3] = place
    assert terminated(KeyframeTermination(G1, max_displacement=0.5), after) == ends
