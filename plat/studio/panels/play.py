"""Panel of the playing policies, their errors and their scores."""

import numpy as np
import viser

from plat.studio.desk import Task
from plat.studio.page import Page
from plat.studio.tables import keyframe_table, live_line, policy_table

__all__ = ["PlayPanel"]

_ALONE = "nobody"
_COLORS = ("#1c7ed6", "#e8590c")


class PlayPanel:
    """Panel that selects and compares policies, and shows errors while they play and scores after it."""

    def __init__(self, page: Page):
        self._page, gui = page, page.gui
        self._playback = playback = page.session.playback
        self._policy = gui.add_dropdown("Policy", tuple(playback.policies), initial_value=playback.policy)
        page.when_changed(self._policy, lambda: playback.choose(self._policy.value))
        self._beside = gui.add_dropdown(
            "Beside it", (_ALONE, *playback.policies), hint="Another policy that plays the same keyframes at its side."
        )
        page.when_changed(self._beside, self._set_beside)
        self.follow = gui.add_checkbox("Follow the robot", initial_value=True)
        self._live = gui.add_markdown("")
        self._plot = gui.add_uplot(
            _nothing(),
            (
                {"label": "s"},
                {"label": "it (m)", "stroke": _COLORS[0], "width": 2},
                {"label": "beside (m)", "stroke": _COLORS[1], "width": 2},
            ),
            title="Distance from the keyframe",
            scales={"x": {"time": False}, "y": {}},
            height=170,
            padding=(8, 16, 0, 0),
        )
        self._keyframes = gui.add_markdown("")
        page.slow_button(
            "Compare all policies",
            self._compare,
            f"Playing {len(playback.policies)} policies at full speed …",
            hint="On the keyframes as they are now.",
            icon=viser.Icon.SCALE,
        )
        self._policies = gui.add_markdown("")

    def _set_beside(self) -> None:
        self._playback.set_beside(None if self._beside.value == _ALONE else self._beside.value)

    def _compare(self) -> Task:
        timeline = self._page.session.timeline
        scores = self._playback.compare(timeline)
        return lambda: self._playback.take_scores(timeline, scores)

    def show(self) -> None:
        """Update the tables."""
        playback, timeline = self._playback, self._page.session.timeline
        names = [name for name in (playback.policy, playback.beside) if name in playback.scores]
        tables = [keyframe_table(timeline, playback.scores[name]) for name in dict.fromkeys(names)]
        if len(tables) > 1:
            tables = [f"**{name}**\n\n{table}" for name, table in zip(names, tables, strict=True)]
        _set(self._keyframes, "\n\n".join(tables))
        _set(self._policies, policy_table(playback.scores))
        self.show_time()

    def show_time(self) -> None:
        """Update what changes while a policy plays."""
        playback, lines = self._playback, []
        for name, player in playback.players.items():
            step = player.step_at(playback.cursor)
            if step is not None:
                line = live_line(step, player.errors[step.timing.steps(step.time) - 1])
                lines.append(f"**{name}** {line}" if playback.second else line)
        _set(self._live, "\n\n".join(lines) or "Press *Play* (space) to see what the policy makes of the keyframes.")
        first, second = playback.player, playback.second
        if first is None or not first.times:
            self._plot.data = _nothing()
            return
        times = np.array(first.times)
        errors = np.array([error.keypoint for error in first.errors])
        others = np.full(len(times), np.nan)
        if second is not None:
            other = np.array([error.keypoint for error in second.errors])[: len(times)]
            others[: len(other)] = other
        self._plot.data = times, errors, others


def _set(handle: viser.GuiMarkdownHandle, text: str) -> None:
    if handle.content != text:
        handle.content = text


def _nothing() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.zeros(1), np.zeros(1), np.zeros(1)
