import pytest
import torch
from tensordict import TensorDict

from plat.errors import ConfigError
from plat.modules import GoalLead, KeyframeLead


def goals(*roots: list[float]) -> TensorDict:
    """Frames whose root is here (m) and whose two keypoints are on it and a meter above."""
    frames = {}
    for number, root in enumerate(roots, 1):
        position = torch.tensor([root])
        up = torch.tensor([[0.0, 0.0, 1.0]])
        frames[f"g{number}"] = {"root_pos_b": position, "keypoint_pos_b": torch.cat((position, position + up), -1)}
    return TensorDict(frames, [1])


def test_frames_are_shown_ahead_along_the_reference_velocity():
    lead = GoalLead(("g1", "g2"), lead=0.1, gain=0.0, interval=0.02)
    shown = lead(goals([0.0, 0.0, 0.0], [0.04, 0.0, 0.02]))  # 2 m/s forward, 1 m/s up
    torch.testing.assert_close(shown["led_g1", "root_pos_b"], torch.tensor([[0.2, 0.0, 0.1]]))
    torch.testing.assert_close(shown["led_g2", "root_pos_b"], torch.tensor([[0.24, 0.0, 0.12]]))
    torch.testing.assert_close(shown["led_g1", "keypoint_pos_b"], torch.tensor([[0.2, 0.0, 0.1, 0.2, 0.0, 1.1]]))


def test_distance_is_shown_larger_but_not_without_bound():
    lead = GoalLead(("g1",), lead=0.0, gain=1.0, interval=0.02, limit=0.5)
    assert lead(goals([0.1, -0.2, 0.3]))["led_g1", "root_pos_b"][0].tolist() == pytest.approx([0.2, -0.4, 0.3])
    assert lead(goals([0.0, 2.0, 0.0]))["led_g1", "root_pos_b"][0].tolist() == pytest.approx([0.0, 2.5, 0.0])
    assert lead(goals([0.0, 0.0, 0.0]))["led_g1", "root_pos_b"].abs().max() == 0


def test_a_keyframe_in_the_place_of_both_frames_has_no_velocity():
    lead = GoalLead(("g1", "g1"), lead=0.1, gain=0.0, interval=0.02)
    keyframe = goals([1.0, 0.5, 0.1])
    assert torch.equal(lead(keyframe)["led_g1", "keypoint_pos_b"], keyframe["g1", "keypoint_pos_b"])


def test_a_lead_takes_two_frames():
    with pytest.raises(ValueError, match="velocity takes two frames"):
        GoalLead(("g1",), lead=0.1, gain=0.0, interval=0.02)


@pytest.mark.parametrize(
    ("time_left", "ahead"),
    [
        (1.0, 0.05),  # a meter in a second takes 1 m/s
        (0.25, 0.2),
        (0.1, 0.5),
        (0.02, 0.5),  # not 2.5 m
        (0.0, 0.5),
    ],
)
def test_a_keyframe_is_shown_ahead_along_the_velocity_that_it_takes(time_left, ahead):
    keyframe = goals([0.6, -0.8, 0.3]).rename_key_("g1", "goal")
    keyframe["command", "horizon"] = torch.tensor([[time_left / 2]])
    shown = KeyframeLead(0.05, horizon=2.0)(keyframe)["led_goal"]
    root = [0.6 * (1 + ahead), -0.8 * (1 + ahead), 0.3]
    assert shown["root_pos_b"][0].tolist() == pytest.approx(root)
    assert shown["keypoint_pos_b"][0].tolist() == pytest.approx([*root, *root[:2], 1.3])


def test_a_lead_moves_only_bodies_that_are_commanded():
    keyframe = goals([0.6, -0.8, 0.3]).rename_key_("g1", "goal")
    keyframe["goal", "keypoint_pos_b"][:, :3] = 0.0  # not commanded
    parts = {"bodies": torch.tensor([[0.0, 1.0]]), "root": torch.ones(1, 3)}
    keyframe.update({"command": {"horizon": torch.ones(1, 1)}, "parts": parts})
    lead = KeyframeLead(0.05, horizon=1.0, parts=True)
    keyframe["parts", "root"][:, 0] = 0.0  # a height alone, in a root that leans
    assert torch.equal(lead(keyframe.clone())["led_goal"]["root_pos_b"], keyframe["goal", "root_pos_b"])
    keyframe["parts", "root"][:, 0] = 1.0
    shown = lead(keyframe)["led_goal"]
    assert shown["keypoint_pos_b"][0].tolist() == pytest.approx([0.0, 0.0, 0.0, 0.63, -0.84, 1.3])


def test_a_robot_that_is_there_sees_its_keyframe_where_it_is():
    keyframe = goals([0.0, 0.0, 0.1]).rename_key_("g1", "goal")
    keyframe["command", "horizon"] = torch.zeros(1, 1)
    shown = KeyframeLead(0.05, horizon=1.0)(keyframe.clone())["led_goal"]
    assert torch.equal(shown["keypoint_pos_b"], keyframe["goal", "keypoint_pos_b"])


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        (KeyframeLead, {"horizon": 0.0}, "lead: horizon is 0.0, expected a number above 0"),
        (KeyframeLead, {"horizon": 1.0, "shortest": 0.0}, "lead: shortest is 0.0, expected a number above 0"),
        (KeyframeLead, {"horizon": 1.0, "lead": -0.1}, "lead: lead is -0.1, expected a number of at least 0"),
        (GoalLead, {"interval": 0.0}, "lead: interval is 0.0, expected a number above 0"),
        (GoalLead, {"gain": -1.0}, "lead: gain is -1.0, expected a number of at least 0"),
        (GoalLead, {"limit": float("nan")}, "lead: limit is nan, expected a number of at least 0"),
        (GoalLead, {"groups": (), "lead": 0.0}, "lead: groups is .., expected a tuple"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(kind, settings, message):
    usual = {"groups": ("g1", "g2"), "gain": 1.0, "interval": 0.02} if kind is GoalLead else {}
    with pytest.raises(ConfigError, match=message):
        kind(**{"lead": 0.05, **usual, **settings})
