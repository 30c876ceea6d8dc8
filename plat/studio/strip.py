"""Timeline picture: keyframes over time."""

from collections.abc import Sequence
from html import escape

from plat.control import FELL, LATE_OR_OFF, REACHED, KeyframeScore
from plat.studio.timeline import Timeline

__all__ = ["strip"]

_NEUTRAL, _SELECTED, _NOW = "#8d99a6", "#1c7ed6", "#f08c00"
_COLORS = {REACHED: "#12b76a", LATE_OR_OFF: "#f76707", FELL: "#e5484d"}
_HEIGHT, _AXIS = 52, 34
# Begin and end of a panel's sliders (pixels), so that keyframes stand above their knobs.
_LEFT, _RIGHT = 118, 11


def strip(
    timeline: Timeline, end: float, now: float | None = None, scores: Sequence[KeyframeScore] | None = None
) -> str:
    """Return HTML that draws keyframes as diamonds on a time axis.

    Args:
        timeline: the keyframes.
        end: length of the axis (s).
        now: time being played (s).
        scores: of the keyframes; reached ones are green, late or off ones orange, falls red.

    >>> from plat.robots import G1
    >>> strip(Timeline.empty(G1).inserted(G1.default_qpos), end=1.0).count("<path")
    2
    """

    marks = [f'<line x1="0" x2="100%" y1="{_AXIS}" y2="{_AXIS}" stroke="#c3cbd3" stroke-width="3"/>']
    for half in range(int(2 * end) + 1):
        whole = half % 2 == 0
        tick = f'<line y1="{_AXIS}" y2="{_AXIS + (10 if whole else 6)}" stroke="#c3cbd3" stroke-width="2"/>'
        marks.append(_at(half / 2, end, tick + (_text(_HEIGHT, f"{half // 2} s", _NEUTRAL) if whole else "")))
    for number, (pose, label) in enumerate(zip(timeline.poses, timeline.labels, strict=True)):
        selected = number == timeline.selected
        color, size = _NEUTRAL, 9 if selected else 7
        if scores is not None and number > 0:
            scored = scores[number - 1]
            color = _COLORS[FELL if scored.fell_afterwards else scored.outcome]
        diamond = (
            f'<path d="M0 {_AXIS - size} l{size} {size} l-{size} {size} l-{size} -{size}z" fill="{color}" '
            f'stroke="{_SELECTED if selected else "white"}" stroke-width="2.5"/>'
        )
        marks.append(_at(pose.time, end, diamond + _text(_AXIS - 15, label, _SELECTED if selected else "#5c6670")))
    if now is not None:
        marks.append(_at(now, end, f'<line y1="4" y2="{_AXIS + 12}" stroke="{_NOW}" stroke-width="3"/>'))
    return (
        f'<div style="margin:0.4em {_RIGHT}px 0.2em {_LEFT}px"><svg width="100%" height="{_HEIGHT}" '
        f'style="overflow:visible;display:block" role="img" aria-label="timeline">{"".join(marks)}</svg></div>'
    )


def _at(time: float, end: float, content: str) -> str:
    return f'<svg x="{100 * min(time / end, 1.0):.2f}%" overflow="visible">{content}</svg>'


def _text(y: float, text: str, color: str) -> str:
    return (
        f'<text y="{y}" text-anchor="middle" font-family="sans-serif" font-size="11" fill="{color}">'
        f"{escape(text)}</text>"
    )
