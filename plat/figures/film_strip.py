"""Film strips: several policies on the same keyframes, one under the other."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from plat.bounds import Count, check_value
from plat.errors import RecordsError
from plat.figures.style import PAGE, paper_style

if TYPE_CHECKING:  # a figure is drawn without OpenGL; only the stage that it is given needs that
    from plat.rendering import Playback, Stage

__all__ = ["film_strip"]

_REACHED, _FAILED = "#009E73", "#D55E00"


def film_strip(stage: "Stage", playbacks: "Mapping[str, Playback]", commands: int = 4, last: str = "arrival") -> Any:
    """Return a figure with one strip for each policy: halfway to each of the first keyframes, and at its arrival.

    The keyframe is a ghost. Arrivals have a green frame; a command that failed has a red one and shows the robot
    where it failed.

    Args:
        stage: draws the pictures; upright ones fill a page best.
        playbacks: by the policies' names, of the same commands.
        commands: number of keyframes, where there are as many.
        last: what the last picture shows.

    Raises:
        RecordsError: without playbacks.
        ConfigError: for a number of keyframes that is none.
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    check_value("film strip: commands", commands, Count)
    if not playbacks:
        raise RecordsError("film strip: no playbacks, expected at least one")
    first = next(iter(playbacks.values()))
    starts = _starts(first)[:commands]
    lengths = first.command_length[starts]
    arrivals = lengths.cumsum() * first.dt
    times = np.stack((arrivals - (lengths - lengths // 2) * first.dt, arrivals), 1).flatten()
    strips = {name: _strip(stage, playback, len(starts)) for name, playback in playbacks.items()}
    with paper_style() as plt:
        height, width = strips[next(iter(strips))][0][0].shape[:2]
        size = (PAGE, PAGE / len(times) * height / width * len(strips) + 0.2)
        figure, panels = plt.subplots(len(strips), len(times), figsize=size, squeeze=False)
        figure.get_layout_engine().set(w_pad=0.012, h_pad=0.012, wspace=0.0, hspace=0.0)
        for row, (name, strip) in zip(panels, strips.items(), strict=True):
            for panel, (picture, color) in zip(row, strip, strict=True):
                panel.imshow(picture)
                panel.set(xticks=[], yticks=[])
                for spine in panel.spines.values():
                    spine.set(visible=color is not None, color=color, linewidth=1.5)
            row[0].set_ylabel(name, fontsize=7)
        for number, (panel, time) in enumerate(zip(panels[0], times, strict=True)):
            shown = last if number == len(times) - 1 else "arrival"
            panel.set_title(f"{time:.2f} s, {shown}" if number % 2 else f"{time:.2f} s", pad=3, fontsize=7)
    return figure


def _starts(playback: "Playback") -> np.ndarray:
    """Return the steps at which commands begin."""
    ended = (playback.steps_left <= 1) | playback.failed
    return np.flatnonzero(np.concatenate(([True], ended[:-1])))


def _strip(stage: "Stage", playback: "Playback", commands: int) -> list[tuple[np.ndarray, str | None]]:
    """Return two pictures per command, each with the color of its frame."""
    starts = _starts(playback)
    ends = np.append(starts[1:], len(playback.qpos)) - 1
    pictures = []
    for start, end in zip(starts[:commands], ends[:commands], strict=True):
        halfway = start + playback.command_length[start] // 2
        target = playback.target_qpos[start]
        for pose, at_arrival in ((playback.qpos[min(halfway, end)], False), (playback.reached_qpos[end], True)):
            stage.look_at(_between(pose, target))
            failed = playback.failed[end] and (at_arrival or halfway > end)
            color = _FAILED if failed else _REACHED if at_arrival else None
            pictures.append((stage.draw(pose, target).copy(), color))
    return pictures


def _between(pose: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return a floor point halfway to the target, but close enough to the robot to keep it visible."""
    way = 0.5 * (target[:2] - pose[:2])
    return pose[:2] + way * min(1.0, 0.4 / max(float(np.linalg.norm(way)), 1e-9))
