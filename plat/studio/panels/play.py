"""Panel of the playing policies, their errors and their scores."""

import viser

from plat.errors import PlatError
from plat.studio.desk import Task
from plat.studio.page import Page
from plat.studio.policy_playback import nobody
from plat.studio.tables import keyframe_table, live_line, policy_table
from plat.words import counted

__all__ = ["PlayPanel"]


class PlayPanel:
    """Panel that selects and compares policies, and shows errors while they play and scores after it."""

    def __init__(self, page: Page):
        self._page, gui = page, page.gui
        self._playback = playback = page.session.playback
        self._policy = gui.add_dropdown("Policy", tuple(playback.policies), initial_value=playback.policy)
        page.when_changed(self._policy, self._choose)
        self._alone = nobody(playback.policies)
        self._beside = gui.add_dropdown(
            "Beside it",
            (self._alone, *playback.policies),
            hint="Another policy that plays the same keyframes at its side.",
        )
        page.when_changed(self._beside, self._set_beside)
        self.follow = gui.add_checkbox("Follow the robot", initial_value=True)
        page.when_changed(self.follow)
        self._live = gui.add_markdown("")
        self._keyframes = gui.add_markdown("")
        page.slow_button(
            "Compare all policies",
            self._compare,
            f"Playing {counted(len(playback.policies), 'policy', 'policies')} at full speed …",
            hint="On the keyframes as they are now.",
            icon=viser.Icon.SCALE,
        )
        self._policies = gui.add_markdown("")

    def _choose(self, policy: str) -> None:
        try:
            self._playback.choose(policy)
        except PlatError:
            self._policy.value = self._playback.policy
            raise

    def _set_beside(self, policy: str) -> None:
        self._playback.set_beside(None if policy == self._alone else policy)

    def _compare(self) -> Task:
        timeline = self._page.session.timeline
        compared = self._playback.compare(timeline)
        return lambda: self._playback.take_scores(timeline, *compared)

    def show(self) -> None:
        """Update the tables."""
        playback, timeline = self._playback, self._page.session.timeline
        names = [name for name in (playback.policy, playback.beside) if name in playback.scores]
        tables = [keyframe_table(timeline, playback.scores[name]) for name in dict.fromkeys(names)]
        if len(tables) > 1:
            tables = [f"**{name}**\n\n{table}" for name, table in zip(names, tables, strict=True)]
        _set(self._keyframes, "\n\n".join(tables))
        _set(self._policies, policy_table(timeline, playback.scores, playback.notes))
        self.show_time()

    def show_time(self) -> None:
        """Update what changes while a policy plays."""
        playback, timeline, lines = self._playback, self._page.session.timeline, []
        for name, player in playback.players:
            step = player.step_at(playback.cursor)
            if step is not None:
                line = live_line(timeline, step, player.errors[step.timing.steps(step.time) - 1])
                lines.append(f"**{name}** {line}" if playback.second else line)
        _set(self._live, "\n\n".join(lines) or "Press *Play* (space) to see what the policy makes of the keyframes.")


def _set(handle: viser.GuiMarkdownHandle, text: str) -> None:
    if handle.content != text:
        handle.content = text
