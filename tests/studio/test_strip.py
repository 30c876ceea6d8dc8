import re

from plat.robots import G1
from plat.studio.strip import strip
from plat.studio.timeline import Timeline
from tests.control.made_up import score

TIMELINE = Timeline.empty(G1).inserted(G1.default_qpos, 0.5).inserted(G1.default_qpos, 1.0, "<wave>")


def test_keyframes_stand_where_their_times_are():
    assert re.findall(r'<svg x="([\d.]+)%" overflow="visible"><path', strip(TIMELINE, end=2.0)) == [
        "0.00",
        "25.00",
        "75.00",
    ]


def test_labels_are_not_taken_for_html():
    assert "2 &lt;wave&gt;" in strip(TIMELINE, end=2.0)


def test_scores_are_green_orange_and_red():
    plain = strip(TIMELINE, end=2.0)
    scores = [
        score(0, None, 0.5),
        score(1, None, 1.5, "late or off"),
    ]
    scored = strip(TIMELINE, end=2.0, scores=scores)
    for color in ("#12b76a", "#f76707"):
        assert color not in plain
        assert scored.count(color) == 1
    assert "#e5484d" in strip(TIMELINE, end=2.0, scores=[scores[0], score(1, None, 1.5, "fell")])
    assert "#e5484d" in strip(TIMELINE, end=2.0, scores=[scores[0], score(1, None, 1.5, fell_afterwards=True)])


def test_the_time_that_is_played_stays_on_the_axis():
    assert 'x="50.00%"' in strip(TIMELINE, end=2.0, now=1.0)
    assert 'x="100.00%"' in strip(TIMELINE, end=2.0, now=9.0)
