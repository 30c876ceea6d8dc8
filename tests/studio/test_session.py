import json
import re
from contextlib import nullcontext

import numpy as np
import pytest

from plat.errors import ActionError, KeyframeError, MotionError, StudioError
from plat.motions import MotionClip, generate_motions
from plat.rendering import RenderingError
from plat.robots import G1
from plat.spec.parts import Parts
from plat.studio.timeline import NEW_INTERVAL
from tests.control.puppets import Kicking
from tests.crossed import ABOVE, BELOW
from tests.studio.conftest import squat

pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")

from plat.studio.poser import WHOLE, Frame
from plat.studio.session import Session

LEFT_ELBOW = G1.joint_names.index("left_elbow")
LEFT_PITCH, RIGHT_PITCH = (7 + G1.joint_names.index(f"{side}_shoulder_pitch") for side in ("left", "right"))


@pytest.fixture
def session(policies) -> Session:
    return Session(G1, policies)


def with_squat(session: Session) -> Session:
    session.add()
    session.pose(squat())
    session.add()
    session.stand()
    return session


def play(session: Session) -> None:
    session.playback.play()
    while session.playback.playing:
        session.playback.tick(0.05)


def test_a_slider_is_one_step_to_undo(session):
    session.add()
    for angle in (0.7, 0.8, 0.9):
        session.set_joint(LEFT_ELBOW, angle)
    session.set_joint(LEFT_ELBOW + 1, 0.1)
    session.undo()
    assert session.timeline.pose.joint_pos[LEFT_ELBOW] == 0.9
    session.undo()
    assert session.timeline.pose.joint_pos[LEFT_ELBOW] == pytest.approx(0.6)
    session.redo()
    assert session.timeline.pose.joint_pos[LEFT_ELBOW] == 0.9


def test_a_slider_after_a_pause_is_another_step(session):
    session.add()
    session.set_joint(LEFT_ELBOW, 0.8)
    session.rest()
    session.set_joint(LEFT_ELBOW, 0.9)
    session.undo()
    assert session.timeline.pose.joint_pos[LEFT_ELBOW] == 0.8


def test_a_pause_within_a_drag_does_not_divide_it(session):
    session.add()
    hand = session.poser.frames(session.timeline.pose.qpos)["left hand"]
    session.grab("left hand", [])
    for height in (0.1, 0.2):
        session.drag(Frame(hand.pos + np.array([0.0, 0.0, height]), hand.quat))
        session.rest()
    session.release()
    session.undo()
    np.testing.assert_array_equal(session.timeline.pose.qpos, G1.default_qpos)
    session.begin_drag()  # the ring of a joint
    for angle in (0.7, 0.8):
        session.set_joint(LEFT_ELBOW, angle)
        session.rest()
    session.release()
    session.undo()
    np.testing.assert_array_equal(session.timeline.pose.qpos, G1.default_qpos)


def test_a_slider_of_another_keyframe_is_another_step(session):
    session.add()
    session.set_joint(LEFT_ELBOW, 0.9)
    session.select(0)
    session.set_joint(LEFT_ELBOW, 0.1)
    session.undo()
    assert session.timeline.start.joint_pos[LEFT_ELBOW] == pytest.approx(0.6)
    assert session.timeline.keyframes[0].joint_pos[LEFT_ELBOW] == 0.9


def test_a_drag_is_one_step_to_undo_and_keeps_what_is_held(session):
    session.add()
    frames = session.poser.frames(session.timeline.pose.qpos)
    hand, foot = frames["left hand"], frames["right foot"]
    before = session.timeline.pose.qpos
    for _ in range(2):
        session.grab("left hand", ["left foot", "right foot"])
        for height in (0.1, 0.2, 0.3):
            session.drag(Frame(hand.pos + np.array([0.1, 0.0, height]), hand.quat))
        session.release()
    after = session.poser.frames(session.timeline.pose.qpos)
    np.testing.assert_allclose(after["left hand"].pos, hand.pos + np.array([0.1, 0.0, 0.3]), atol=0.02)
    np.testing.assert_allclose(after["right foot"].pos, foot.pos, atol=0.005)
    session.undo()
    session.undo()
    np.testing.assert_array_equal(session.timeline.pose.qpos, before)


def test_a_drag_without_a_grip_does_nothing(session):
    session.add()
    session.drag(Frame(np.ones(3), np.array([1.0, 0, 0, 0])))
    np.testing.assert_array_equal(session.timeline.pose.qpos, G1.default_qpos)


def test_a_drag_to_where_no_robot_can_be_is_refused_once(session):
    session.add()
    level = np.array([1.0, 0.0, 0.0, 0.0])
    for _ in range(2):
        session.grab(WHOLE, [])
        with pytest.raises(KeyframeError, match="at a height of"):
            session.drag(Frame(np.array([0.0, 0.0, 6.0]), level))
        session.drag(Frame(np.array([0.0, 0.0, 7.0]), level))
        session.drag(Frame(np.array([0.5, 0.0, 0.0]), level))
        session.drag(Frame(np.array([0.0, 0.0, 6.0]), level))
        session.release()
        np.testing.assert_allclose(session.timeline.pose.qpos[:2], [0.5, 0.0], atol=1e-9)


def test_a_drag_leaves_a_pose_alone_that_was_selected_meanwhile(session):
    with_squat(session)
    session.select(1)
    hand = session.poser.frames(session.timeline.pose.qpos)["left hand"]
    session.grab("left hand", [])
    session.drag(Frame(hand.pos + 0.05, hand.quat))
    dragged, other = session.timeline.keyframes
    session.select(2)
    session.drag(Frame(hand.pos + 0.1, hand.quat))
    session.release()
    assert session.timeline.keyframes == (dragged, other)
    session.undo()
    np.testing.assert_array_equal(session.timeline.keyframes[0].qpos, squat())


def test_copies_are_pasted_after_the_selected_pose(session):
    with_squat(session)
    session.select(1)
    session.edit(session.timeline.renamed("down"))
    session.copy()
    session.select(2)
    session.paste()
    assert session.timeline.labels == ("start", "1 down", "2", "3 down")
    np.testing.assert_array_equal(session.timeline.pose.qpos, session.timeline.keyframes[0].qpos)
    assert session.timeline.pose.time == pytest.approx(3 * NEW_INTERVAL)


def test_there_is_nothing_to_paste_at_first(session):
    with pytest.raises(KeyframeError, match="copy a keyframe first"):
        session.paste()


def test_poses_are_mirrored_dropped_and_flattened(session):
    with_squat(session)
    session.select(1)
    session.mirror()
    assert session.timeline.pose.qpos[RIGHT_PITCH] == pytest.approx(-1.0)
    assert session.timeline.pose.qpos[LEFT_PITCH] == pytest.approx(0.2)
    session.set_root(np.array([0.3, 0.1, 1.5, 1.0, 0.0, 0.0, 0.0]), "root")
    session.drop()
    assert 0.6 < session.timeline.pose.qpos[2] < 0.75
    session.flatten_feet()
    feet = session.poser.frames(session.timeline.pose.qpos)
    assert abs(feet["left foot"].quat[2]) < 0.01
    session.stand()
    np.testing.assert_allclose(session.timeline.pose.qpos[7:], G1.default_qpos[7:])
    np.testing.assert_allclose(session.timeline.pose.qpos[:2], [0.3, 0.1], atol=0.02)


def test_arms_are_led_around_on_the_way_to_the_selected_keyframe(session):
    for pose, interval in ((ABOVE, 1.0), (BELOW, 1.0)):
        session.edit(session.timeline.inserted(pose, interval))
    session.edit(session.timeline.select(1).held(0.5).select(2))
    session.lead_around()
    assert [frame.time for frame in session.timeline.keyframes] == [1.0, 2.0, 2.5]
    assert session.timeline.selected == 3
    np.testing.assert_array_equal(session.timeline.pose.qpos, BELOW.qpos)
    assert not np.allclose(session.timeline.poses[2].qpos, (ABOVE.qpos + BELOW.qpos) / 2, atol=0.05)
    with pytest.raises(KeyframeError, match="^the straight way to this keyframe is clear: there is nothing to lead"):
        session.lead_around()
    session.undo()
    assert [frame.time for frame in session.timeline.keyframes] == [1.0, 2.5]
    session.select(0)
    with pytest.raises(KeyframeError, match="^the start pose cannot be gone to: select a keyframe"):
        session.lead_around()


def test_what_a_mirrored_keyframe_commands_changes_sides(session):
    session.add()
    session.edit(session.timeline.commanding(Parts.only(G1, joints=["left_elbow"], bodies=["left_knee_link"])))
    session.set_joint(LEFT_ELBOW, 0.9)
    session.mirror()
    pose = session.timeline.pose
    assert pose.commands.names(G1) == {"joints": ["right_elbow"], "bodies": ["right_knee_link"], "root": []}
    assert pose.joint_pos[G1.joint_names.index("right_elbow")] == pytest.approx(0.9)
    session.undo()
    assert session.timeline.pose.commands.names(G1)["joints"] == ["left_elbow"]
    assert session.timeline.pose.joint_pos[LEFT_ELBOW] == 0.9


def test_playing_ends_with_scores(session):
    with_squat(session)
    play(session)
    assert [keyframe.reached for keyframe in session.playback.scores["plat"]] == [True, True]
    session.playback.choose("expert")
    play(session)
    assert set(session.playback.scores) == {"plat", "expert"}


def test_edits_throw_scores_away(session):
    with_squat(session)
    play(session)
    session.select(1)
    assert session.playback.scores
    session.set_joint(LEFT_ELBOW, 0.0)
    assert not session.playback.scores
    assert session.playback.player is None, "what it played is no more"


def test_edits_are_obeyed_while_playing(session):
    with_squat(session)
    session.playback.play()
    session.playback.tick(0.1)
    session.select(2)
    session.set_joint(LEFT_ELBOW, 0.0)
    assert session.playback.playing
    assert session.playback.player.sequence.keyframes[1].joint_pos[LEFT_ELBOW] == 0.0
    while session.playback.playing:
        session.playback.tick(0.05)
    assert not session.playback.scores, "half of it was played with other keyframes"
    session.playback.play()
    session.new()
    assert not session.playback.playing


def test_another_policy_takes_over(session):
    with_squat(session)
    session.playback.play()
    session.playback.tick(0.1)
    session.playback.choose("expert")
    while session.playback.playing:
        session.playback.tick(0.05)
    assert session.playback.player.times[-1] > 1.0
    assert not session.playback.scores


def test_nothing_to_play(session):
    with pytest.raises(KeyframeError, match="no keyframes yet: press A"):
        session.playback.play()


def test_all_policies_are_compared_as_if_played(session):
    with_squat(session)
    play(session)
    played = session.playback.scores["plat"]
    scores, notes = session.playback.compare(session.timeline)
    assert not notes
    assert list(scores) == ["plat", "expert"]
    assert scores["plat"] == played
    compared = session.timeline
    session.select(1)
    session.playback.take_scores(compared, scores, notes)
    assert set(session.playback.scores) == {"plat", "expert"}
    session.set_joint(LEFT_ELBOW, 0.0)
    session.playback.take_scores(compared, scores, notes)
    assert not session.playback.scores, "they are of other keyframes"


def test_files_come_back_with_the_same_scores(session, policies, tmp_path):
    with_squat(session)
    play(session)
    session.save(tmp_path / "squat.json")
    other = Session(G1, policies)
    other.load(tmp_path / "squat.json")
    assert other.timeline.selected == 1
    play(other)
    assert other.playback.scores == session.playback.scores
    other.undo()
    assert other.timeline.labels == ("start",)
    other.from_json("mine.json", session.to_json())
    assert [frame.time for frame in other.timeline.keyframes] == [frame.time for frame in session.timeline.keyframes]


def test_keyframes_far_apart_stay_as_they_are_in_files(session):
    with_squat(session)
    content = json.loads(session.to_json())
    content["keyframes"][1]["time"] = 3.2
    session.from_json("far.json", json.dumps(content).encode())
    assert [frame.time for frame in session.timeline.keyframes] == [0.6, 3.2]
    assert len(session.timeline.sequence()) == 4, "they are split when they are played"


def test_a_load_that_ends_the_chase_of_a_policy_for_whole_poses_is_a_load(session, tmp_path):
    with_squat(session)
    session.save(whole := tmp_path / "whole.json")
    session.edit(session.timeline.commanding(Parts.only(G1, joints=("left_elbow",))))
    session.save(partial := tmp_path / "partial.json")
    session.load(whole)
    session.playback.play()
    session.load(partial)
    assert not session.playback.players
    assert "commands a part of its pose" in session.playback.refused
    assert not session.timeline.keyframes[-1].whole
    assert not session.unsaved


def test_unsaved_changes_are_known(session, tmp_path):
    assert not session.unsaved
    with_squat(session)
    assert session.unsaved
    session.to_json()
    assert session.unsaved, "a download is no file of the studio's"
    session.save(tmp_path / "a.json")
    session.select(0)
    assert not session.unsaved
    session.set_joint(LEFT_ELBOW, 0.0)
    assert session.unsaved


def test_a_keyframe_is_added_at_the_cursor(session):
    with_squat(session)
    session.seek(0.3)
    assert not session.shows_selected
    session.add()
    assert [frame.time for frame in session.timeline.keyframes] == [0.3, 0.6, 1.2]
    knee = 7 + G1.joint_names.index("left_knee")
    assert session.timeline.pose.qpos[knee] == pytest.approx((G1.default_qpos[knee] + 1.2) / 2)
    session.seek(1.2)
    assert session.timeline.selected == 3
    session.add()
    assert session.timeline.duration == pytest.approx(1.8)


def test_a_keyframe_is_added_at_a_time_and_where_one_is_it_is_selected(session):
    with_squat(session)
    session.select(1)
    session.edit(session.timeline.held(0.5))
    session.edit(session.timeline.renamed("down"))
    before, arrivals = session.timeline.keyframes, [0.6, 1.7]
    for time in (0.6, 0.9, 1.1):
        session.select(0)
        session.add_at(time)
        assert session.timeline.selected == 1
    assert session.timeline.keyframes is before
    session.add_at(0.9)
    assert [frame.time for frame in session.timeline.keyframes] == arrivals
    session.add_at(2.5)
    assert [frame.time for frame in session.timeline.keyframes] == [*arrivals, 2.5]
    session.add_at(0.3)
    assert [frame.time for frame in session.timeline.keyframes] == [0.3, *arrivals, 2.5]
    assert session.timeline.selected == 1
    session.undo()
    session.undo()
    assert session.timeline.keyframes is before, "two steps in all: a selection is none"
    session.new()
    session.add_at(1.2)
    assert session.timeline.duration == pytest.approx(1.2)
    with pytest.raises(KeyframeError, match="at 31.30 s would be 30.10 s after the end, expected at most 30 s"):
        session.add_at(31.3)
    assert session.timeline.duration == pytest.approx(1.2)


def test_a_keyframe_after_the_end_of_what_was_played_has_no_name(session):
    session.add()
    session.edit(session.timeline.renamed("rise"))
    play(session)
    assert session.playback.cursor > session.timeline.duration
    session.add()
    assert session.timeline.labels == ("start", "1 rise", "2")
    assert session.timeline.duration == pytest.approx(2 * NEW_INTERVAL)


@pytest.mark.parametrize(("axis", "value"), [(2, 7.6), (2, -6.0), (0, 2000.0)])
def test_a_pose_that_no_file_may_hold_is_refused(session, axis, value):
    session.add()
    before, root = session.timeline, session.timeline.pose.qpos[:7]
    root[axis] = value
    with pytest.raises(KeyframeError, match="root_pos puts the root"):
        session.set_root(root, "position")
    assert session.timeline is before
    session.playback.sequence("plat")


def test_cut_keyframes_can_be_pasted(session):
    with_squat(session)
    session.select(1)
    session.edit(session.timeline.held(0.4))
    session.cut()
    assert len(session.timeline.keyframes) == 1
    session.paste()
    np.testing.assert_array_equal(session.timeline.pose.qpos, squat())
    assert session.timeline.hold == pytest.approx(0.4), "it is the keyframe, not its pose alone"


def test_symmetric_posing_moves_both_sides(session):
    session.add()
    session.symmetric = True
    session.set_joint(LEFT_ELBOW, 0.9)
    assert session.timeline.pose.joint_pos[G1.joint_names.index("right_elbow")] == pytest.approx(0.9)
    frames = session.poser.frames(session.timeline.pose.qpos)
    hand = frames["left hand"]
    session.grab("left hand", ["left foot", "right foot", "pelvis"])
    session.drag(Frame(hand.pos + np.array([0.1, 0.05, 0.2]), hand.quat))
    session.release()
    after = session.poser.frames(session.timeline.pose.qpos)
    np.testing.assert_allclose(after["left hand"].pos * [1, -1, 1], after["right hand"].pos, atol=2e-3)


def test_templates_follow_the_selected_pose(session):
    session.add()
    session.insert_template("bow")
    assert session.timeline.labels == ("start", "1", "2 bow", "3 rise")
    assert session.timeline.selected == 2
    with pytest.raises(StudioError, match="expected one of wave, bow"):
        session.insert_template("fly")


@pytest.mark.parametrize("content", [b"", b"{}", b"\xff\xfe", b'{"format": "plat-keyframes", "version": 7}'])
def test_bad_files_are_named_and_change_nothing(session, content: bytes):
    with_squat(session)
    before = session.timeline
    with pytest.raises(KeyframeError, match=r"keyframe file 'mine.json': ") as caught:
        session.from_json("mine.json", content)
    assert "\n" not in str(caught.value)
    assert session.timeline is before


def test_poses_are_taken_out_of_clips(session):
    clip = generate_motions("val", seconds=8)[1]
    session.add()
    session.set_root(np.array([1.0, 2.0, 0.7, 1.0, 0.0, 0.0, 0.0]), "root")
    session.take_pose(clip, 2.0, insert=False)
    frame = clip.qpos[100]
    np.testing.assert_allclose(session.timeline.pose.qpos[7:], frame[7:], atol=1e-5)
    np.testing.assert_allclose(session.timeline.pose.qpos[:3], [1.0, 2.0, frame[2]], atol=1e-5)
    session.take_pose(clip, 2.0, insert=True)
    assert len(session.timeline.keyframes) == 2


def test_a_stretch_of_a_clip_becomes_keyframes_where_the_start_stands(session):
    clip = generate_motions("val", seconds=8)[1]
    session.set_root(np.array([1.0, 2.0, 0.76, 1.0, 0.0, 0.0, 0.0]), "root")
    session.take_stretch(clip, begin=1.0, seconds=2.0, interval=0.5)
    assert [frame.time for frame in session.timeline.keyframes] == pytest.approx([0.5, 1.0, 1.5, 2.0])
    np.testing.assert_allclose(session.timeline.start.qpos[:2], [1.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(session.timeline.keyframes[1].joint_pos, clip.qpos[100, 7:], atol=1e-5)


def test_clips_beyond_the_joint_limits_can_be_taken(session):
    qpos = np.tile(G1.default_qpos, (60, 1))
    qpos[:, 7 + LEFT_ELBOW] = 9.0
    clip = MotionClip("beyond", qpos, 30.0)
    session.take_stretch(clip, begin=0.0, seconds=1.0, interval=0.5)
    session.take_pose(clip, 1.0, insert=True)
    assert session.timeline.sequence().keyframes[0].joint_pos[LEFT_ELBOW] == pytest.approx(
        float(G1.joint_range[LEFT_ELBOW, 1])
    )


def test_a_broken_or_short_clip_is_refused(session):
    with pytest.raises(MotionError, match="not finite|finite number"):
        session.take_pose(MotionClip("bad", np.full((5, 36), np.nan), 30.0), 0.0, insert=False)
    short = MotionClip("short", np.tile(G1.default_qpos, (5, 1)), 30.0)
    with pytest.raises(KeyframeError, match=r"less than 0.5 s of the clip are left: begin earlier"):
        session.take_stretch(short, begin=0.0, seconds=5.0, interval=0.5)


def test_a_video_is_an_mp4(session, tmp_path):
    with_squat(session)
    with pytest.raises(RenderingError, match=r"ends in \.mp4"):
        session.record(session.timeline, "plat", tmp_path / "video.txt")


def test_a_video_is_recorded(session, tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg", reason="the extra plat-rl[video] is not installed")
    monkeypatch.setattr("plat.studio.player.HOLD", 0.0)
    session.add()
    session.edit(session.timeline.stretched(0.1))
    assert session.record(session.timeline, "plat", tmp_path / "new" / "video.mp4") == ""
    assert (tmp_path / "new" / "video.mp4").stat().st_size > 1000


@pytest.mark.parametrize("taken", [0, 3])
def test_a_video_of_a_simulation_that_ends_early_is_of_what_there_is(session, tmp_path, monkeypatch, taken):
    filmed = []
    monkeypatch.setattr("plat.studio.session.Stage", lambda *_, **__: nullcontext())
    monkeypatch.setattr("plat.studio.session.film", lambda stage, playback: playback)
    monkeypatch.setattr("plat.studio.session.write_video", lambda path, playback: filmed.append(len(playback.qpos)))
    monkeypatch.setattr(session.playback, "controller", lambda _: Kicking(taken))
    with_squat(session)
    told = rf"at 0.0{2 * taken} s: the simulation diverged 0.0{2 * taken} s after .*; it fell from there on"
    if taken:
        assert re.fullmatch(told, session.record(session.timeline, "plat", tmp_path / "video.mp4"))
    else:
        with pytest.raises(ActionError, match=told):
            session.record(session.timeline, "plat", tmp_path / "video.mp4")
    assert filmed == [taken] * bool(taken)
