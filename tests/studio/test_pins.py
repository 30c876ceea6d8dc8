import pytest

from plat.robots import G1
from plat.studio.pins import PRESETS, faint_bodies, pinned, preset, toggled
from plat.studio.timeline import Timeline

KEYFRAME = Timeline.empty(G1).inserted(G1.default_qpos, 0.5).pose


def with_pins(*handles: str):
    from dataclasses import replace

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


@pytest.mark.parametrize("name", PRESETS)
def test_choices_pin_their_handles(name: str):
    from dataclasses import replace

    frame = replace(KEYFRAME, commands=preset(name, G1))
    assert frame.whole == (name == "whole pose")
    if not frame.whole:
        assert pinned(frame, G1) == frozenset(PRESETS[name])
