import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from plat.errors import StudioError
from plat.keyframes import Keyframe, standing
from plat.robots import G1

pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("viser", reason="the extra plat-rl[studio] is not installed")

from plat.studio.app import Studio
from plat.studio.checker import Checker
from plat.studio.desk import Desk
from plat.studio.panels import TimelinePanel
from plat.studio.session import Session
from plat.studio.timeline import Timeline
from tests.control import made_up


@pytest.fixture
def panel(policies) -> TimelinePanel:
    """A panel that does at once what it is asked."""
    desk = SimpleNamespace(ask=lambda task, instead_of=None: task())
    return TimelinePanel(SimpleNamespace(session=Session(G1, policies), desk=desk), Checker(G1), {})


@pytest.mark.parametrize(("value", "time"), [(1, 0.06), (-1, 0.02)])
def test_a_keyframe_between_control_steps_is_nudged_by_one(panel, value, time):
    session = panel._page.session
    frame = standing(G1).at(0.05)  # arrives at 0.04 s
    session.edit(Timeline(G1, standing(G1), (frame,), 1))
    panel.receive({"do": "nudge", "value": value})
    assert session.timeline.pose.time == time


def test_a_desk_that_is_behind_moves_each_keyframe_to_its_own_time(panel):
    session = panel._page.session
    frames = tuple(standing(G1).at(time) for time in (1.0, 2.0, 3.0))
    session.edit(Timeline(G1, standing(G1), frames, 1))
    panel._page.desk = desk = Desk(lambda _: None, lambda: desk.stop(), pytest.fail, 10.0)
    for number, times in ((1, (1.1, 1.2)), (2, (2.2, 2.4)), (3, (3.2, 3.4))):
        panel.receive({"do": "select", "number": number})
        for time in times:
            panel.receive({"do": "retime", "number": number, "time": time})
        panel.receive({"do": "end"})
    for number, hold in ((1, 0.2), (2, 0.4)):
        panel.receive({"do": "select", "number": number})
        panel.receive({"do": "hold", "value": hold})
    assert len(desk._tasks) == 13, "of what is dragged the last"
    desk.run()
    assert session.timeline.holds == (0.2, 0.4, 0.0)
    assert [frame.time for frame in session.timeline.keyframes] == pytest.approx([1.2, 2.6, 4.0])


@pytest.mark.parametrize("dragged", ["retime", "hold"])
def test_a_drag_with_a_pause_is_one_step_to_undo(panel, dragged):
    session = panel._page.session
    session.edit(Timeline(G1, standing(G1), (standing(G1).at(1.0),), 1))
    before = session.timeline
    panel.receive({"do": "select", "number": 1})
    panel.receive({"do": "drag"})
    for value in (1.2, 1.4):
        panel.receive({"do": dragged, "number": 1, "time": value, "value": value})
        session.rest()
    panel.receive({"do": "end"})
    panel.receive({"do": "nudge", "value": 1})
    session.rest()
    panel.receive({"do": "nudge", "value": 1})
    for _ in range(2):  # after a drag pauses count again
        session.undo()
        assert session.timeline.keyframes != before.keyframes
    session.undo()
    assert session.timeline.keyframes == before.keyframes


def test_what_is_typed_is_for_the_keyframe_that_was_seen(panel):
    session = panel._page.session
    frames = tuple(standing(G1).at(time) for time in (1.0, 2.0))
    session.edit(Timeline(G1, standing(G1), frames, 1))
    panel.receive({"do": "select", "number": 2})  # on another page
    panel.receive({"do": "rename", "number": 1, "value": "up"})
    panel.receive({"do": "hold", "number": 1, "value": 0.2})
    panel.receive({"do": "interval", "number": 1, "value": 0.8})
    assert [frame.name for frame in session.timeline.keyframes] == ["up", None]
    assert session.timeline.holds == (0.2, 0.0)
    assert [frame.time for frame in session.timeline.keyframes] == pytest.approx([0.8, 2.0])


@pytest.mark.parametrize("value", [[1], {"1x": 1}, None, 3, "9x", [[1] * 500]])
def test_a_speed_that_is_none_is_named(panel, value):
    with pytest.raises(StudioError, match="expected one of 1x, 1/2, 1/4, 1/10$") as error:
        panel.receive({"do": "speed", "value": value})
    assert len(str(error.value)) < 500


@pytest.mark.parametrize(
    "message",
    [
        {"do": "select", "number": [1]},
        {"do": "seek", "time": float("nan")},
        {"do": "step", "value": 10**400},
        {"do": "retime"},
    ],
)
def test_what_is_no_number_is_named(panel, message):
    with pytest.raises(StudioError, match="expected a number"):
        panel.receive(message)


def test_the_page_draws_no_distance_where_no_place_is_commanded(policies):
    shown = {}
    session = Session(G1, policies)
    errors = [made_up.errors(keypoint=distance) for distance in (0.1234, math.nan)]
    session.playback.played, session.playback.player = "a", SimpleNamespace(errors=errors, time=0.04, finished=True)
    page = SimpleNamespace(session=session, dock=SimpleNamespace(show=shown.__setitem__))
    TimelinePanel(page, Checker(G1), {}).show_time()
    assert json.dumps(shown["distances"]["of"], allow_nan=False) == "[[0.123, null]]"


@pytest.mark.parametrize(("frames", "shown"), [(10, 10.0), (1000, 30.0), (1, 5.0), (float("nan"), 30.0), ("10", 30.0)])
def test_a_browser_says_how_often_it_draws(frames, shown):
    studio = SimpleNamespace(_frames=30.0)
    Studio._suit(studio, {"do": "browser", "frames": frames})
    assert studio._frames == shown


def test_a_start_that_no_robot_stays_in_has_the_sign_of_doubtful_keyframes(panel):
    session, shown = panel._page.session, {}
    panel._page.dock = SimpleNamespace(show=shown.__setitem__)
    low = Keyframe.from_qpos(0.0, G1.default_qpos - 0.5 * np.eye(36)[2])
    for start, words in ((standing(G1), ()), (low, ("the robot is 50 cm inside the floor",))):
        session.edit(Timeline(G1, start, (standing(G1).at(1.0),), 1))
        panel.show()
        assert shown["timeline"]["poses"][0]["words"] == words
