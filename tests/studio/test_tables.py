import math

import pytest

from plat.control import PoseErrors
from plat.robots import G1
from plat.studio.player import Player
from plat.studio.tables import keyframe_table, live_line, policy_table
from plat.studio.timeline import Timeline
from tests.control import made_up
from tests.control.made_up import score
from tests.control.puppets import Puppet


def timeline_of(sequence) -> Timeline:
    return Timeline.of(sequence.start, sequence.keyframes, G1, sequence.timing)


SCORES = [
    score(0, "squat", 0.5),
    score(1, None, 1.0, "late or off", 0.2, 0.04, faults=("0.12 s late", "0.35 m off")),
]


def test_a_row_a_keyframe(sequence):
    rows = keyframe_table(timeline_of(sequence), SCORES).splitlines()
    assert rows[2:] == [
        "| 1 squat | 0.50 s | reached | 0.100 | 20 |",
        "| 2 | 1.00 s | late or off: 0.12 s late, 0.35 m off | 0.200 | 40 |",
    ]
    fell = [SCORES[0], score(1, None, 1.0, "fell")]
    assert "| fell |" in keyframe_table(timeline_of(sequence), fell)
    afterwards = [SCORES[0], score(1, None, 1.0, fell_afterwards=True)]
    assert "| reached; fell afterwards |" in keyframe_table(timeline_of(sequence), afterwards)


@pytest.mark.parametrize(
    ("outcomes", "whole"),
    [
        (("late or off", "reached", "reached", "reached"), "1 of 1 reached"),
        (("fell", "reached", "reached", "reached"), "0 of 1 reached, 1 fell"),
        (("reached", "late or off", "reached", "reached"), "0 of 1 reached, 1 late or off"),
        (("reached", "reached", "reached", "late or off"), "0 of 1 reached, 1 late or off"),
        (("reached", "late or off", "fell", "fell"), "0 of 1 reached, 1 fell"),
    ],
)
def test_poses_on_the_way_count_where_the_robot_falls(outcomes, whole):
    timeline = Timeline.empty(G1).inserted(G1.default_qpos, 2.0, "far").held(2.0)
    scores = [score(number, "far", number + 1.0, outcome) for number, outcome in enumerate(outcomes)]
    assert policy_table(timeline, {"plat": scores}, {}).splitlines()[2].split("|")[2].strip() == whole
    rows = keyframe_table(timeline, scores).splitlines()[2:]
    assert [row.split("|")[1].strip() for row in rows] == ["way to 1 far", "1 far", "1 far", "1 far"]


def test_a_row_a_policy(sequence):
    notes = {"old": "did not play: it is for whole poses", "expert": "at 1.00 s: it diverged"}
    rows = policy_table(timeline_of(sequence), {"plat": SCORES, "expert": SCORES[1:]}, notes).splitlines()
    assert rows[2:] == [
        "| plat | 1 of 2 reached, 1 late or off | 0.150 | 30 |",
        r"| expert | 0 of 1 reached, 1 late or off; at 1\.00 s: it diverged | 0.200 | 40 |",
        "| old | did not play: it is for whole poses | - | - |",
    ]


def test_no_scores_no_table(sequence):
    assert keyframe_table(timeline_of(sequence), None) == ""
    assert policy_table(timeline_of(sequence), {}, {}) == ""


def test_names_are_not_taken_for_markdown():
    timeline = Timeline.empty(G1).inserted(G1.default_qpos, name="a|b *c* <i>")
    row = keyframe_table(timeline, SCORES[:1]).splitlines()[2]
    assert r"1 a\|b \*c\* \<i\>" in row


@pytest.mark.parametrize(
    ("steps", "errors", "expected"),
    [
        (1, made_up.errors(0.25, 0.5), "0.0 s: keyframe **1 squat** in 0.48 s, 0.50 m and 0.25 rad away"),
        (
            30,
            made_up.errors(0.25, 0.5, down=True),
            "0.6 s: keyframe **2** in 0.40 s, 0.50 m and 0.25 rad away **fallen**",
        ),
        (1, made_up.errors(math.nan, 0.5), "0.0 s: keyframe **1 squat** in 0.48 s, 0.50 m away"),
        (1, made_up.errors(math.nan, math.nan), "0.0 s: keyframe **1 squat** in 0.48 s"),
        (55, made_up.errors(), "1.1 s: keyframe **2** held, 0.00 m and 0.00 rad away"),
    ],
)
def test_live(sequence, steps: int, errors: PoseErrors, expected: str):
    player = Player(G1, Puppet(), sequence)
    for _ in range(steps):
        player.advance(0.0201)
    assert live_line(timeline_of(sequence), player.step, errors) == expected
