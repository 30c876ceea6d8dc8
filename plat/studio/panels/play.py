"""Panel of the playing policy, its errors and its scores."""

import numpy as np

from plat.studio.desk import Task
from plat.studio.page import Page
from plat.studio.tables import keyframe_table, live_line, policy_table

__all__ = ["PlayPanel"]


class PlayPanel:
    """Panel that selects and compares policies, and shows errors while one plays and scores after it."""

    def __init__(self, page: Page):
        self._page, session, gui = page, page.session, page.gui
        self._policy = gui.add_dropdown("Policy", tuple(session.policies), initial_value=session.policy)
        page.when_changed(self._policy, lambda: session.choose(self._policy.value))
        self.loop = gui.add_checkbox("Loop", initial_value=False)
        self.follow = gui.add_checkbox("Follow the robot", initial_value=True)
        self._live = gui.add_markdown("")
        self._plot = gui.add_uplot(
            _nothing(),
            (
                {"label": "s"},
                {"label": "keypoints (m)", "stroke": "#1c7ed6", "width": 2},
                {"label": "joints (rad)", "stroke": "#f08c00", "width": 2},
            ),
            scales={"x": {"time": False}, "y": {}},
            height=170,
            padding=(8, 16, 0, 0),
        )
        self._keyframes = gui.add_markdown("")
        compare = gui.add_button("Compare all policies", hint="At full speed, on the keyframes as they are now.")

        async def clicked(_: object) -> None:
            page.desk.ask_elsewhere(self._compare)

        compare.on_click(clicked)
        self._policies = gui.add_markdown("")

    def _compare(self) -> Task:
        session = self._page.session
        timeline = session.timeline
        scores = session.compare(timeline)
        return lambda: session.take_scores(timeline, scores)

    def show(self) -> None:
        """Update the tables."""
        session = self._page.session
        self._keyframes.content = keyframe_table(session.timeline, session.scores.get(session.policy))
        self._policies.content = policy_table(session.scores)
        self.show_time()

    def show_time(self) -> None:
        """Update what changes while a policy plays."""
        player = self._page.session.player
        if player is None or player.step is None:
            self._live.content, self._plot.data = "Not playing.", _nothing()
            return
        self._live.content = live_line(player.step, player.errors[-1])
        self._plot.data = (
            np.array(player.times),
            np.array([errors.keypoint for errors in player.errors]),
            np.array([errors.joint for errors in player.errors]),
        )


def _nothing() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.zeros(1), np.zeros(1), np.zeros(1)
