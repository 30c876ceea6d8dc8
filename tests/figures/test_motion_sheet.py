"""Contact sheets of clips."""

import numpy as np
import pytest

from plat.errors import MotionError, PlatError
from plat.figures import motion_sheet
from tests.figures.test_film_strip import Painter
from tests.motions.formats.writers import bowing_clip

pytest.importorskip("matplotlib")


class Eye(Painter):
    def draw(self, qpos, ghost_qpos=None):
        return super().draw(qpos, ghost_qpos)


def test_a_row_a_clip_with_its_name_and_the_times_of_its_pictures():
    eye, clips = Eye(), [bowing_clip(51), bowing_clip(101)]
    figure = motion_sheet(eye, clips, columns=3)
    assert len(figure.axes) == 6
    assert [panel.get_title() for panel in figure.axes] == ["0.0 s", "0.5 s", "1.0 s", "0.0 s", "1.0 s", "2.0 s"]
    assert [panel.texts[0].get_text() for panel in figure.axes[::3]] == [clip.name for clip in clips]
    np.testing.assert_array_equal([pose for pose, _ in eye.seen[:3]], clips[0].qpos[[0, 25, 50]])


def test_nothing_to_draw_is_refused():
    with pytest.raises(MotionError, match="no clips, expected at least one"):
        motion_sheet(Eye(), [])
    with pytest.raises(PlatError, match="columns is 0"):
        motion_sheet(Eye(), [bowing_clip()], columns=0)
