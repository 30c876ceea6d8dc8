from pathlib import Path

import pytest

from plat.motions import MotionClip, save_motions
from tests.motions.formats.writers import bowing_clip, write_csv


@pytest.fixture
def folder(tmp_path) -> Path:
    """A good csv, and a plat npz with a clip that floats and one to drop."""
    folder = tmp_path / "in"
    folder.mkdir()
    write_csv(folder / "good_50fps.csv", bowing_clip(60))
    floating, short = bowing_clip(60), bowing_clip(10)
    floating.qpos[:, 2] += 0.1
    clips = [MotionClip("floating", floating.qpos, 50.0), MotionClip("short", short.qpos, 50.0)]
    save_motions(folder / "two.npz", clips)
    return folder
