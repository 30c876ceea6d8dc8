"""Contact sheets of motion clips."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from plat.bounds import Count, check_value
from plat.errors import MotionError
from plat.figures.pyplot import pyplot
from plat.motions.clip import MotionClip

if TYPE_CHECKING:  # see film_strip.py
    from plat.rendering import Stage

__all__ = ["motion_sheet"]

_INCHES = 1.5


def motion_sheet(stage: "Stage", clips: Sequence[MotionClip], columns: int = 8) -> Any:
    """Return a figure with a row of pictures for each clip, evenly spaced in time, with its name and their times.

    Args:
        stage: draws the pictures; square ones fill the figure.
        clips: of the stage's robot.
        columns: pictures in a row.

    Raises:
        MotionError: when there are no clips.
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    check_value("motion_sheet: columns", columns, Count)
    if not clips:
        raise MotionError("motion_sheet: no clips, expected at least one")
    from plat.rendering import stills

    rows = len(clips)
    title = 0.25 / rows
    figure, panels = pyplot().subplots(
        rows,
        columns,
        figsize=(_INCHES * columns, 1.3 * _INCHES * rows),
        squeeze=False,
        gridspec_kw={"left": 0.005, "right": 0.995, "bottom": 0, "top": 1 - title, "hspace": 0.3, "wspace": 0.03},
    )
    for row, clip in zip(panels, clips, strict=True):
        for panel, frame, picture in zip(row, *stills(stage, clip.qpos, columns), strict=True):
            panel.imshow(picture)
            panel.set_axis_off()
            panel.set_title(f"{frame / clip.fps:.1f} s", fontsize=7, pad=2)
        row[0].text(0, 1.16, clip.name, fontsize=8, transform=row[0].transAxes, parse_math=False)
    return figure
