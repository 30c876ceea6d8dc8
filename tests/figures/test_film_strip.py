import dataclasses

import numpy as np
import pytest

from plat.envs.transforms import HORIZONS, CommandSchedule
from plat.errors import ConfigError, RecordsError
from plat.evaluation import play
from plat.figures import film_strip
from plat.modules import Expert
from plat.motions import MotionLibrary
from plat.robots import G1
from tests.conftest import standing_clip

pytest.importorskip("matplotlib")
GREEN, RED = "#009E73", "#D55E00"


class Painter:
    """Draws no robot, but remembers who stood for the picture."""

    def __init__(self):
        self.seen: list[tuple[np.ndarray, np.ndarray]] = []
        self.aims: list[np.ndarray] = []

    def look_at(self, position):
        self.aims.append(position[:2])

    def draw(self, qpos, ghost_qpos):
        self.seen.append((qpos, ghost_qpos))
        return np.zeros((12, 8, 3), dtype=np.uint8)


@pytest.fixture(scope="module")
def playback():
    library = MotionLibrary.from_clips([standing_clip(frames=121)])  # four seconds
    return play(Expert(G1).deployed(), library, 0, HORIZONS["long"])


@pytest.fixture
def well(playback):
    """The same commands, none of them failed: made of the schedule alone."""
    library = MotionLibrary.from_clips([standing_clip(frames=121)])
    schedule = CommandSchedule(library, HORIZONS["long"], 0)
    ends = schedule.target_frame[schedule.first_frame]
    lengths = (ends - schedule.first_frame).numpy()
    steps = int(lengths.sum())
    number = np.repeat(np.arange(len(lengths)), lengths)
    qpos = np.arange(steps)[:, None] * np.ones(36)
    return dataclasses.replace(
        playback,
        qpos=qpos,
        reached_qpos=qpos + 0.5,
        target_qpos=-np.ones((steps, 36)) * number[:, None],
        command_length=lengths[number],
        steps_left=np.concatenate([np.arange(length, 0, -1) for length in lengths]),
        failed=np.zeros(steps, dtype=bool),
    )


def edges(figure) -> list[str | None]:
    spines = [panel.spines["left"] for panel in figure.axes]
    return [spine.get_edgecolor() if spine.get_visible() else None for spine in spines]


def test_halfway_and_arrival_of_each_keyframe(well):
    painter = Painter()
    figure = film_strip(painter, {"PLAT": well}, commands=2)
    first, second = well.command_length[0], well.command_length[well.command_length[0]]
    shown = [(pose[0], target[0]) for pose, target in painter.seen]
    halves = (first // 2, first - 0.5, first + second // 2, first + second - 0.5)
    assert shown == list(zip(halves, (0, 0, -1, -1), strict=True))
    titles = [panel.get_title() for panel in figure.axes]
    assert titles[1] == f"{first * 0.02:.2f} s, arrival"
    assert titles[2] == f"{(first + second // 2) * 0.02:.2f} s"
    assert [edge is not None for edge in edges(figure)] == [False, True, False, True]
    held = film_strip(Painter(), {"PLAT": well}, commands=2, last="held")
    titles = [panel.get_title() for panel in held.axes]
    assert [title.split(", ")[-1] for title in titles[1::2]] == ["arrival", "held"]


def test_a_failed_command_shows_where_it_failed(well):
    length = well.command_length[0]
    keep = np.r_[0:5, length : len(well.qpos)]  # failed in its fifth step, put back at the next command
    arrays = [field.name for field in dataclasses.fields(well) if field.name not in ("dt", "words")]
    columns = {name: getattr(well, name) for name in arrays}
    failing = dataclasses.replace(well, **{name: column[keep] for name, column in columns.items()})
    failing.failed[4] = True
    painter = Painter()
    figure = film_strip(painter, {"PLAT": well, "wbc": failing}, commands=2)
    assert [pose[0] for pose, _ in painter.seen[4:6]] == [4, 4.5]
    assert painter.seen[6][0][0] == painter.seen[2][0][0]  # the next command is seen at the same time again
    from matplotlib.colors import to_hex

    assert [edge and to_hex(edge).upper() for edge in edges(figure)] == [None, GREEN] * 2 + [RED, RED, None, GREEN]
    assert [panel.get_ylabel() for panel in figure.axes[::4]] == ["PLAT", "wbc"]


def test_the_robot_is_seen_however_far_the_keyframe_is(well):
    near = dataclasses.replace(well, qpos=0 * well.qpos, reached_qpos=0 * well.qpos, target_qpos=0 * well.qpos + 0.2)
    far = dataclasses.replace(near, target_qpos=0 * well.qpos + 20.0)
    for playback, aim in ((near, [0.1, 0.1]), (far, [0.4 * 0.5**0.5] * 2)):
        painter = Painter()
        film_strip(painter, {"PLAT": playback}, commands=1)
        np.testing.assert_allclose(painter.aims[0], aim)


def test_no_more_keyframes_than_there_are(playback):
    figure = film_strip(Painter(), {"expert": playback}, commands=100)
    commands = CommandSchedule(MotionLibrary.from_clips([standing_clip(frames=121)]), HORIZONS["long"], 0).num_commands
    assert len(figure.axes) == 2 * commands


def test_strips_of_nothing_are_one_line(playback):
    with pytest.raises(RecordsError, match="film strip: no playbacks"):
        film_strip(Painter(), {})
    with pytest.raises(ConfigError, match="film strip: commands is 0, expected a whole number of at least 1"):
        film_strip(Painter(), {"PLAT": playback}, commands=0)
