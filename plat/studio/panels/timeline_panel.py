"""Timeline at the bottom of the page: what a user does there, and the state that it shows."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from plat.control import KeyframeScore
from plat.errors import StudioError
from plat.json_file import short
from plat.studio.checker import Checker
from plat.studio.dock import Message
from plat.studio.page import Page
from plat.studio.policy_playback import SPEEDS
from plat.studio.tables import drawn_scores, grade
from plat.studio.timeline import LONGEST_INTERVAL, Timeline

__all__ = ["TimelinePanel"]

# Messages that come many times a second while something is dragged: only the last one counts.
_DRAGGED = ("seek", "retime", "hold")


class TimelinePanel:
    """Panel that edits and plays keyframes over time.

    Args:
        page: the page.
        checker: says what is doubtful about keyframes.
        actions: what else a user can ask for, by name.
    """

    def __init__(self, page: Page, checker: Checker, actions: Mapping[str, Callable[[], None]]):
        self._page, self._checker = page, checker
        session, playback = page.session, page.session.playback
        edit = session.edit
        self._actions: dict[str, Callable[[Message], None]] = {
            **{name: _ignoring(action) for name, action in actions.items()},
            "toggle": lambda _: playback.toggle(),
            "stop": lambda _: playback.stop(),
            "step": lambda message: playback.step(int(_number(message, "value"))),
            "speed": self._set_speed,
            "loop": lambda _: setattr(playback, "loop", not playback.loop),
            "select": lambda message: session.select(int(_number(message, "number"))),
            "previous": lambda _: session.select(session.timeline.selected - 1),
            "next": lambda _: session.select(session.timeline.selected + 1),
            "first": lambda _: session.select(0),
            "last": lambda _: session.select(len(session.timeline.keyframes)),
            "seek": lambda message: session.seek(_number(message, "time")),
            "retime": self._retime,
            "nudge": self._nudge,
            "hold": self._hold,
            "interval": lambda message: edit(self._meant(message).stretched(_number(message, "value"))),
            "rename": lambda message: edit(self._meant(message).renamed(str(message.get("value", ""))[:60])),
            "drag": lambda _: session.begin_drag(),
            "end": lambda _: session.end_drag(),
            "add": self._add,
            "copy": lambda _: session.copy(),
            "cut": lambda _: session.cut(),
            "paste": lambda _: session.paste(),
            "mirror": lambda _: session.mirror(),
            "stand": lambda _: session.stand(),
            "floor": lambda _: session.drop(),
            "remove": lambda _: edit(session.timeline.removed()),
            "undo": lambda _: session.undo(),
            "redo": lambda _: session.redo(),
        }

    def receive(self, message: Message) -> None:
        """Queue what a user did; unknown requests are ignored."""
        name = message["do"]
        if name in self._actions:
            dragged = (name, str(message.get("number"))) if name in _DRAGGED else None
            self._page.desk.ask(lambda: self._actions[name](message), dragged)

    def _meant(self, message: Message) -> Timeline:
        """Return the timeline with the keyframe selected that the user saw, which another page may have left since."""
        timeline = self._page.session.timeline
        return timeline.select(int(_number(message, "number"))) if "number" in message else timeline

    def _add(self, message: Message) -> None:
        if "time" in message:
            self._page.session.add_at(_number(message, "time"))
        else:
            self._page.session.add()

    def _hold(self, message: Message) -> None:
        timeline = self._meant(message)
        self._page.session.edit(timeline.held(_number(message, "value")), ("hold", timeline.selected))

    def _retime(self, message: Message) -> None:
        session, number = self._page.session, int(_number(message, "number"))
        if 0 < number < len(session.timeline.poses):
            session.edit(session.timeline.select(number).retimed(number, _number(message, "time")), ("time", number))

    def _nudge(self, message: Message) -> None:
        session = self._page.session
        number, pose = session.timeline.selected, session.timeline.pose
        if number:
            step = session.timing.steps(pose.time) + _number(message, "value")
            session.edit(session.timeline.retimed(number, step * session.timing.control_dt), ("nudge", number))

    def _set_speed(self, message: Message) -> None:
        label = message.get("value")
        if not isinstance(label, str) or label not in SPEEDS:
            raise StudioError(f"speed {short(label)}, expected one of {', '.join(SPEEDS)}")
        self._page.session.playback.speed = SPEEDS[label]

    def show(self) -> None:
        """Update all that is not only the time."""
        session = self._page.session
        timeline = session.timeline
        scores = drawn_scores(timeline, session.playback.scores.get(session.playback.policy, ()))
        verdicts = (self._checker.start(timeline.start), *self._checker.timeline(timeline))
        poses: list[dict[str, Any]] = []
        for number, (pose, label, verdict) in enumerate(zip(timeline.poses, timeline.labels, verdicts, strict=True)):
            poses.append(
                {
                    "time": pose.time,
                    "hold": timeline.holds[number - 1] if number else 0.0,
                    "label": label,
                    "name": pose.name or "",
                    "words": verdict.words,
                    "joint": verdict.joint,
                    "speed": round(verdict.speed, 2),
                    "share": round(verdict.share, 3),
                    **_result(scores.get(number)),
                }
            )
        arrivals = {pose.time for pose in timeline.to_keyframes()}
        played = session.playback.sequence(session.playback.policy).keyframes if timeline.keyframes else ()
        marks = [frame.time for frame in played if frame.time not in arrivals]
        self._page.dock.show(
            "timeline",
            {
                "poses": poses,
                "selected": timeline.selected,
                "interval": timeline.interval,
                "duration": timeline.duration,
                "marks": marks,
                "longest": LONGEST_INTERVAL,
                "undo": session.history.can_undo,
                "redo": session.history.can_redo,
                "paste": session.can_paste,
            },
        )
        shown = timeline.pose if session.shows_selected else timeline.sample(session.playback.cursor)
        self._page.dock.show("check", self._checker.stance(shown.qpos).words)
        self.show_time()

    def show_time(self) -> None:
        """Update the time that is shown."""
        session = self._page.session
        playback = session.playback
        mode = "playing" if playback.playing else "paused" if playback.paused else "still"
        speed = next(label for label, speed in SPEEDS.items() if speed == playback.speed)
        state = {"cursor": round(playback.cursor, 4), "simulated": round(playback.simulated, 4), "mode": mode}
        self._page.dock.show("time", {**state, "speed": speed, "loop": playback.loop})
        distances = [[_distance(error.keypoint) for error in player.errors] for _, player in playback.players]
        self._page.dock.show("distances", {"dt": session.timing.control_dt, "of": distances})


def _distance(value: float) -> float | None:
    # JSON has no NaN, and a browser could not read it
    return None if math.isnan(value) else round(value, 3)


def _result(score: KeyframeScore | None) -> dict[str, str]:
    return {"status": "waiting", "result": ""} if score is None else {"status": grade(score), "result": score.words}


def _ignoring(action: Callable[[], None]) -> Callable[[Message], None]:
    return lambda _: action()


def _number(message: Message, entry: str) -> float:
    value = message.get(entry)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e6:
        raise StudioError(f"{entry} is {short(value)}, expected a number")
    return float(value)
