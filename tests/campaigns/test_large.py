"""A small part of the campaign."""

import os

import numpy as np
import pytest

from plat.cli.motion_files import distinct
from plat.motions import MotionClip, load_motions
from plat.motions.paths import find_files, listed_paths
from tests.campaigns.large import LONG, MANY, Cost, grows

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="files are read in processes that fork")


@pytest.mark.parametrize("name", ["npz, read", "csv, read", "pkl, read", "bvh, read"])
def test_made_up_files_are_whole(tmp_path, name):
    write, work = LONG[name]
    write(tmp_path, 0.5)
    assert work(tmp_path) == 61


@pytest.mark.parametrize("name", ["files one by one, library", "clips in one npz, named apart"])
def test_made_up_libraries_are_whole(tmp_path, name):
    write, work = MANY[name]
    write(tmp_path, 2)
    assert work(tmp_path) == (8 if name.endswith("apart") else 2)


def test_work_that_is_quadratic_is_found():
    assert not grows(Cost(1, 2.0, 0), Cost(2, 4.1, 0))
    assert grows(Cost(1, 2.0, 0), Cost(2, 8.0, 0))


def test_thousands_of_clips_that_are_called_alike_are_named_apart():
    empty = np.empty(0)
    named = distinct([MotionClip("a_2", empty, 1.0), *[MotionClip("a", empty, 1.0)] * 20_000])
    assert [clip.name for clip in named[:4]] == ["a_2", "a", "a_3", "a_4"]
    assert len({clip.name for clip in named}) == 20_001


def test_a_file_that_is_named_and_globbed_is_read_once(tmp_path):
    for name in ("b.npz", "a.npz"):
        LONG["npz, read"][0](tmp_path, 0.1)
        (tmp_path / "long.npz").rename(tmp_path / name)
    patterns = [tmp_path / "b.npz", str(tmp_path / "*.npz"), tmp_path / "b.npz"]
    assert [path.name for path in find_files(patterns, [".npz"])] == ["b.npz", "a.npz"]
    assert listed_paths(patterns) >= {tmp_path / "b.npz"}
    assert len(load_motions(patterns)) == 2
