from dataclasses import replace

import pytest

from plat.control import KeyframeScore, PoseErrors
from plat.robots import G1
from plat.studio.player import Player
from plat.studio.tables import keyframe_table, live_line, policy_table
from plat.studio.timeline import Timeline
from tests.control.puppets import Puppet

SCORES = [
    KeyframeScore(0, "squat", 0.5, True, False, 0.1, 0.02),
    KeyframeScore(1, None, 1.0, False, False, 0.2, 0.04),
]


def test_a_row_a_keyframe(sequence):
    rows = keyframe_table(Timeline.of(sequence), SCORES).splitlines()
    assert rows[2:] == ["| 1 squat | 0.50 s | yes | 0.100 | 0.020 |", "| 2 | 1.00 s | no | 0.200 | 0.040 |"]
    fell = [SCORES[0], replace(SCORES[1], fell=True)]
    assert "| fell |" in keyframe_table(Timeline.of(sequence), fell)


def test_a_row_a_policy():
    rows = policy_table({"plat": SCORES, "expert": SCORES[1:] * 2}).splitlines()
    assert rows[2:] == ["| plat | 1 of 2 | 0.150 | 0.030 |", "| expert | 0 of 2 | 0.200 | 0.040 |"]


def test_no_scores_no_table(sequence):
    assert keyframe_table(Timeline.of(sequence), None) == ""
    assert policy_table({}) == ""


def test_names_are_not_taken_for_markdown():
    timeline = Timeline.empty(G1).inserted(G1.default_qpos, name="a|b *c* <i>")
    row = keyframe_table(timeline, SCORES[:1]).splitlines()[2]
    assert r"1 a\|b \*c\* \<i\>" in row


@pytest.mark.parametrize(
    ("steps", "errors", "expected"),
    [
        (1, PoseErrors(0.25, 0.5, False, False), "0.0 s: keyframe **1 squat** in 0.48 s, 0.50 m and 0.25 rad away"),
        (
            30,
            PoseErrors(0.25, 0.5, False, True),
            "0.6 s: keyframe **2** in 0.40 s, 0.50 m and 0.25 rad away **fallen**",
        ),
        (55, PoseErrors(0.0, 0.0, False, False), "1.1 s: keyframe **2** held, 0.00 m and 0.00 rad away"),
    ],
)
def test_live(sequence, steps: int, errors: PoseErrors, expected: str):
    player = Player(G1, Puppet(), sequence)
    for _ in range(steps):
        player.advance(0.0201)
    assert live_line(player.step, errors) == expected
