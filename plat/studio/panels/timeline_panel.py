"""Panel of keyframes over time."""

from math import ceil

from plat.studio.page import Page
from plat.studio.strip import strip

__all__ = ["TimelinePanel"]


class TimelinePanel:
    """Panel that adds, moves, copies, mirrors, times, removes and plays keyframes."""

    def __init__(self, page: Page):
        self._page, session = page, page.session
        control_dt, longest = session.timing.control_dt, session.timing.longest
        self._strip = page.gui.add_html("")
        self._arrivals = page.gui.add_multi_slider(
            "Arrivals (s)",
            min=0.0,
            max=longest,
            step=control_dt,
            initial_value=(longest,),
            hint="Drag a keyframe to another time; the others stay.",
        )
        self._selected = page.gui.add_dropdown("Selected", session.timeline.labels)
        self._interval = page.gui.add_slider(
            "Takes (s)",
            min=control_dt,
            max=longest,
            step=control_dt,
            initial_value=longest,
            hint="From the pose before; later keyframes move along.",
        )
        self._name = page.gui.add_text("Name", "")
        page.buttons(
            "Keyframe",
            {
                "Add": session.add,
                "Copy": session.copy,
                "Paste": session.paste,
                "Mirror": session.mirror,
                "Earlier": lambda: session.edit(session.timeline.moved(-1)),
                "Later": lambda: session.edit(session.timeline.moved(1)),
                "Remove": lambda: session.edit(session.timeline.removed()),
            },
        )
        play = {"Play": session.play, "Stop": session.stop, "Undo": session.undo, "Redo": session.redo}
        page.buttons("", {**play, "New": session.new})
        page.when_changed(self._arrivals, self._retime)
        page.when_changed(self._selected, lambda: session.select(self._selected.options.index(self._selected.value)))
        page.when_changed(self._interval, self._stretch)
        page.when_changed(self._name, self._rename)
        page.key("Play", "space", lambda: session.stop() if session.playing else session.play())
        page.key("Undo", "Z", session.undo, "cmd/ctrl")
        page.key("Redo", "Z", session.redo, "cmd/ctrl+shift")
        page.key("Previous keyframe", "arrowleft", lambda: session.select(session.timeline.selected - 1))
        page.key("Next keyframe", "arrowright", lambda: session.select(session.timeline.selected + 1))

    def _retime(self) -> None:
        session = self._page.session
        timeline = session.timeline
        asked = self._arrivals.value
        if len(asked) != len(timeline.keyframes):
            return  # of a slider that is no longer there
        shifts = [abs(time - frame.time) for time, frame in zip(asked, timeline.keyframes, strict=True)]
        number = shifts.index(max(shifts)) + 1
        session.edit(timeline.select(number).retimed(number, asked[number - 1]), ("arrival", number))

    def _stretch(self) -> None:
        timeline = self._page.session.timeline
        self._page.session.edit(timeline.stretched(self._interval.value), ("interval", timeline.selected))

    def _rename(self) -> None:
        timeline = self._page.session.timeline
        self._page.session.edit(timeline.renamed(self._name.value), ("name", timeline.selected))

    def show(self) -> None:
        """Update the inputs."""
        timeline = self._page.session.timeline
        times = tuple(frame.time for frame in timeline.keyframes)
        self._arrivals.visible = bool(times)
        if times:
            # the same while the last one is dragged, so that the scale does not change under the mouse
            self._arrivals.max = self._end()
            self._arrivals.value = times
        if self._selected.options != timeline.labels:
            self._selected.options = timeline.labels
        self._selected.value = timeline.labels[timeline.selected]
        self._interval.disabled = self._name.disabled = timeline.selected == 0
        if timeline.selected:
            self._interval.value = round(timeline.interval, 2)
        name = timeline.pose.name or "" if timeline.selected else ""
        if self._name.value.strip() != name:  # a space that is being typed stays
            self._name.value = name
        self.show_time()

    def show_time(self) -> None:
        """Update the picture of the timeline."""
        session = self._page.session
        step = None if session.player is None else session.player.step
        self._strip.content = strip(
            session.timeline, self._end(), None if step is None else step.time, session.scores.get(session.policy)
        )

    def _end(self) -> float:
        """Return the end of the shown time axis (s): the latest time that the last keyframe can be moved to."""
        longest = self._page.session.timing.longest
        frames = self._page.session.timeline.keyframes
        return float(ceil(2 * (frames[-2].time + longest if len(frames) > 1 else longest)) / 2)
