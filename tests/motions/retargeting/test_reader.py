import sys

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import load_motions, read_motion_files
from plat.motions.retargeting import retarget
from tests.motions.formats.writers import bowing_clip, write_csv
from tests.motions.retargeting.human import write_human


def test_human_motion_is_retargeted_as_it_is_read(tmp_path):
    pytest.importorskip("mink")
    write_human(tmp_path / "person.bvh", frames=5)
    (file,) = read_motion_files(tmp_path)
    assert file.format == "human BVH, retargeted"
    assert [clip.name for clip in file.clips] == ["person"]
    assert file.clips[0].qpos.shape == (5, 36)


def test_what_is_wrong_is_named_once(tmp_path):
    (tmp_path / "broken.bvh").write_text("HIERARCHY\nROOT\n")
    with pytest.raises(MotionError, match=r"^motion file '[^']*broken.bvh': line 2: 'ROOT', expected a name"):
        load_motions(tmp_path)


def test_a_stated_rate_wins(tmp_path):
    pytest.importorskip("mink")
    write_human(tmp_path / "person.bvh", frames=5)
    (clip,) = load_motions(tmp_path, fps=60)
    assert clip.fps == 60


def test_a_stated_unit_of_angles_wins(tmp_path):
    pytest.importorskip("mink")
    path = write_human(tmp_path / "person.bvh", frames=5)
    (expected,) = load_motions(path)
    head, rows = path.read_text().split("Frame Time: 0.033333\n")
    values = np.array([[float(word) for word in row.split()] for row in rows.splitlines()])
    values[:, 3:] = np.deg2rad(values[:, 3:])
    path.write_text(f"{head}Frame Time: 0.033333\n" + "\n".join(" ".join(map(str, row)) for row in values))
    (clip,) = load_motions(path, angles="radians")
    np.testing.assert_allclose(clip.qpos, expected.qpos, atol=1e-2)


def test_an_order_of_quaternions_says_nothing_about_a_capture(tmp_path):
    pytest.importorskip("mink")
    write_human(tmp_path / "person.bvh", frames=5)
    told = "person.bvh': quat_order is stated, and says nothing about a human BVH, retargeted: expected no --quat-order"
    with pytest.raises(MotionError, match=told):
        load_motions(tmp_path, quat_order="xyzw")
    write_csv(tmp_path / "bow_50fps.csv", bowing_clip(), "xyzw")
    assert len(load_motions(tmp_path, quat_order="xyzw", angles="degrees")) == 2  # each says something about one


@pytest.mark.parametrize("stated", [{"fps": -30}, {"up": "q"}, {"units": "km"}, {"angles": "grad"}])
def test_what_is_stated_of_a_capture_has_to_be_something(tmp_path, stated):
    pytest.importorskip("mink")
    with pytest.raises(MotionError, match=f"person.bvh': {next(iter(stated))} is .*, expected"):
        retarget(write_human(tmp_path / "person.bvh", frames=5), **stated)


def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch):
    write_human(tmp_path / "person.bvh", frames=5)
    monkeypatch.setitem(sys.modules, "mink", None)
    monkeypatch.delitem(sys.modules, "plat.motions.retargeting.inverse_kinematics", raising=False)
    with pytest.raises(MotionError, match=r"plat-rl\[retarget\]"):
        load_motions(tmp_path)
