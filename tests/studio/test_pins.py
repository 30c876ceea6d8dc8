from dataclasses import replace

import pytest

from plat.robots import G1
from plat.spec.parts import ROOT_PARTS, Parts
from plat.studio.pins import PRESETS, chosen, faint_bodies, pinned, preset, toggled
from plat.studio.poser import WHOLE
from plat.studio.timeline import Timeline

KEYFRAME = Timeline.empty(G1).inserted(G1.default_qpos, 0.5).pose


def with_pins(*handles: str):
    frame = KEYFRAME
    for handle in handles:
        frame = replace(frame, commands=toggled(frame, handle, G1))
    return frame


def test_a_whole_pose_has_all_pins_and_nothing_faint():
    assert {"left hand", "pelvis", "head"} <= pinned(KEYFRAME, G1)
    assert not faint_bodies(KEYFRAME, G1)


def test_pins_are_set_one_by_one_and_taken_out():
    frame = with_pins("left hand", "pelvis")
    assert frame.commands.names(G1) == {
        "joints": [],
        "bodies": ["left_wrist_yaw_link"],
        "root": ["horizontal", "height", "orientation"],
    }
    assert pinned(frame, G1) == {"left hand", "pelvis"}
    assert with_pins("left hand", "pelvis", "left hand", "pelvis").whole, "without a pin it is the whole pose"
    assert pinned(with_pins("head"), G1) == {"chest"}


def test_what_is_not_commanded_is_faint():
    faint = faint_bodies(with_pins("left hand", "pelvis"), G1)
    assert "left_wrist_yaw_link" not in faint
    assert "pelvis" not in faint
    assert {"right_wrist_yaw_link", "torso_link", "left_knee_link"} <= faint


@pytest.mark.parametrize(
    ("commands", "handle", "after"),
    [
        ({"joints": ["left_elbow"]}, "left hand", {"joints": ["left_elbow"], "bodies": ["left_wrist_yaw_link"]}),
        ({"joints": ["left_elbow"]}, "pelvis", {"joints": ["left_elbow"], "root": ROOT_PARTS}),
        ({"root": ["height"]}, "head", {"root": ["height"], "bodies": ["torso_link"]}),
        ({"root": ["height"]}, WHOLE, None),
        ({"bodies": ["left_wrist_yaw_link"], "root": ["height"]}, "left hand", {"root": ["height"]}),
    ],
)
def test_a_pin_changes_nothing_but_its_handle(commands, handle, after):
    frame = replace(KEYFRAME, commands=Parts.only(G1, **commands))
    assert toggled(frame, handle, G1) == (after and Parts.only(G1, **after))


@pytest.mark.parametrize(
    "commands",
    [
        {"joints": ["left_elbow"]},
        {"root": ["height"]},
        {"bodies": ["left_wrist_yaw_link", "right_wrist_yaw_link"], "joints": ["waist_pitch"]},
        {"bodies": ["left_wrist_yaw_link"]},
    ],
)
def test_what_is_no_choice_is_shown_as_none(commands):
    assert chosen(replace(KEYFRAME, commands=Parts.only(G1, **commands)), G1) is None


@pytest.mark.parametrize("name", PRESETS)
def test_choices_pin_their_handles(name: str):
    frame = replace(KEYFRAME, commands=preset(name, G1))
    assert frame.whole == (name == "whole pose")
    assert chosen(frame, G1) == name
    if not frame.whole:
        assert pinned(frame, G1) == frozenset(PRESETS[name])
