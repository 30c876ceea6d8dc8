import numpy as np
import pytest

from plat.control import Feasibility
from plat.keyframes import Keyframe
from plat.robots import G1
from plat.spec.parts import Parts
from plat.studio.checker import Checker, convex_hull
from plat.studio.timeline import Timeline
from tests.studio.conftest import squat

CHECKER = Checker(G1)


def moved(*by: float) -> np.ndarray:
    qpos = G1.default_qpos.copy()
    qpos[: len(by)] += by
    return qpos


def test_the_default_pose_is_balanced_on_both_feet():
    stance = CHECKER.stance(G1.default_qpos)
    assert stance.feet == (True, True)
    assert stance.margin > 0.03
    assert stance.words.startswith("on both feet, balanced")
    assert not stance.inside


def test_a_pose_out_of_balance_and_one_in_the_air_are_told():
    leaning = G1.default_qpos.copy()
    for side in ("left", "right"):
        leaning[7 + G1.joint_names.index(f"{side}_ankle_pitch")] -= 0.45
    turn = 0.45 / 2
    leaning[3:7] = np.cos(turn), 0.0, np.sin(turn), 0.0
    assert "out of balance" in CHECKER.stance(leaning).words or CHECKER.stance(leaning).margin is None
    flying = CHECKER.stance(moved(0.0, 0.0, 0.5))
    assert flying.margin is None
    assert flying.words == "no foot on the floor"
    assert len(flying.support) == 0


def test_links_inside_each_other_are_named():
    folded = G1.default_qpos.copy()
    folded[7 + G1.joint_names.index("left_shoulder_roll")] = -1.2
    stance = CHECKER.stance(folded)
    assert any("left" in body for body in stance.inside)
    assert stance.words.endswith(f", inside each other: {', '.join(sorted(stance.inside))}")


def test_the_fastest_joint_and_impossible_distances_are_told():
    timeline = Timeline.empty(G1).inserted(squat(), 0.5).inserted(squat() + 3 * np.eye(36)[0], 1.0)
    first, second = CHECKER.timeline(timeline)
    assert first.joint == "left_shoulder_pitch"
    assert first.speed == pytest.approx(2 * 1.2 / 0.5)
    assert first.share == pytest.approx(first.speed / 20)
    assert not first.words
    assert "3.0 m in 1.00 s takes 6.0 m/s" in second.words


def test_doubts_are_those_of_the_command_line_also_where_a_pose_is_repeated():
    jumping = moved(0.0, 0.0, 0.2)
    timeline = Timeline.empty(G1).inserted(jumping, 1.0).inserted(G1.default_qpos, 1.0)
    for repeated in (timeline, timeline.select(1).inserted(jumping, 0.6, "again")):
        found = [verdict.words for verdict in CHECKER.timeline(repeated)]
        assert found == [tuple(map(str, concerns)) for concerns in Feasibility(G1).sequence(repeated.sequence())]
    assert found == [("the feet are 20 cm above the floor",), (), ()], "it is to be there from the first to the second"


def test_joints_that_are_not_commanded_do_not_count():
    bent = squat()
    bent[7 + G1.joint_names.index("left_elbow")] += 0.2
    timeline = Timeline.empty(G1).inserted(bent, 0.1)
    elbow = CHECKER.timeline(timeline.commanding(Parts.only(G1, joints=["left_elbow"])))[0]
    assert (elbow.joint, elbow.share) == ("left_elbow", pytest.approx(2 * 0.2 / 0.1 / 20))
    place = CHECKER.timeline(timeline.commanding(Parts.only(G1, root=["height"])))[0]
    assert (place.joint, place.speed, place.share) == ("", 0.0, 0.0)


@pytest.mark.parametrize(("depth", "words"), [(0.02, "on both feet, balanced"), (1.0, "100 cm inside the floor")])
def test_a_robot_in_the_floor_stands_on_no_feet(depth, words):
    assert CHECKER.stance(G1.default_qpos - depth * np.eye(36)[2]).words.startswith(words)


def test_a_start_that_a_robot_at_rest_cannot_stay_in_is_told():
    checker = Checker(G1)
    for pose, said in (
        (moved(), ()),
        (moved(0.0, 0.0, -0.5), ("the robot is 50 cm inside the floor",)),
        (moved(0.0, 0.0, 0.2), ("the feet are 20 cm above the floor",)),
    ):
        verdict = checker.start(Keyframe.from_qpos(0.0, pose))
        assert (verdict.words, verdict.joint, verdict.share) == (said, "", 0.0)


def test_verdicts_follow_edits():
    timeline = Timeline.empty(G1).inserted(squat(), 0.5)
    assert not CHECKER.timeline(timeline)[0].words
    assert "rad/s" in CHECKER.timeline(timeline.stretched(0.06))[0].words[0]
    assert CHECKER.timeline(timeline.held(1.0))[0].speed == CHECKER.timeline(timeline)[0].speed


def test_a_keyframe_that_moves_leaves_the_verdicts_on_others(monkeypatch):
    timeline, checker = Timeline.empty(G1), Checker(G1)
    for number in range(5):
        timeline = timeline.inserted(squat() if number % 2 else G1.default_qpos, 0.5)
    checker.timeline(timeline)
    asked, verdict = [], checker._verdict
    monkeypatch.setattr(checker, "_verdict", lambda *way: asked.append(way) or verdict(*way))
    checker.timeline(timeline.retimed(2, 1.1))
    assert len(asked) == 2, "of the ways to it and from it"


def test_a_hull_contains_all_points():
    points = np.random.default_rng(0).normal(size=(40, 2))
    hull = convex_hull(points)
    for begin, end in zip(hull, np.roll(hull, -1, axis=0), strict=True):
        edge, away = end - begin, points - begin
        assert (edge[0] * away[:, 1] - edge[1] * away[:, 0] >= -1e-9).all(), "all are to the left of each edge"


def test_a_way_begins_where_the_robot_was_last_commanded_to_be():
    timeline = Timeline.empty(G1)
    for x, seconds, commands in (
        (2.0, 3.0, {"root": ["horizontal"]}),
        (0.0, 1.0, {"joints": ["left_elbow"]}),
        (2.1, 0.5, {"root": ["horizontal"]}),
    ):
        timeline = timeline.inserted(moved(x), seconds).commanding(Parts.only(G1, **commands))
    assert [verdict.words for verdict in CHECKER.timeline(timeline)] == [(), (), ()]
