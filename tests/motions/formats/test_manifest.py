import json

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import MotionLibrary, read_motion_files
from plat.motions.files import read_along
from plat.robots import G1

from .test_layouts import clip_with_arms

CLIP = clip_with_arms(0.7)
NAMES = [*(f"root_{axis}" for axis in ("tx", "ty", "tz", "qw", "qx", "qy", "qz")), *G1.joint_names[::-1]]
REVERSED = np.concatenate((CLIP.qpos[:, :7], CLIP.qpos[:, :6:-1]), 1).astype(np.float32)


def write(folder, manifest: object, **arrays: object):
    path = folder / "motions" / "2026" / "bow.npz"
    path.parent.mkdir(parents=True)
    np.savez(path, **arrays)
    (folder / "manifest.json").write_text(manifest if isinstance(manifest, str) else json.dumps(manifest))
    return path


def test_a_manifest_gives_rate_and_names(tmp_path):
    path = write(tmp_path, {"timestep": 0.02, "qpos_names": NAMES, "source": {"fps": 120.0}}, qpos=REVERSED)
    for patterns in (path, tmp_path):
        (file,) = read_motion_files(patterns)
        assert file.clips[0].fps == 50
        np.testing.assert_allclose(file.clips[0].qpos, CLIP.qpos, atol=1e-5)
        assert "timestep, joint_names from manifest.json" in file.facts
    assert read_along(path) == [tmp_path / "manifest.json"]


def test_a_library_depends_on_the_manifest(tmp_path):
    write(tmp_path, {"timestep": 0.02}, qpos=CLIP.qpos)
    assert MotionLibrary.load(str(tmp_path)).duration == pytest.approx(39 * 0.02)
    (tmp_path / "manifest.json").write_text('{"timestep": 0.04}')
    assert MotionLibrary.load(str(tmp_path)).duration == pytest.approx(39 * 0.04)


def test_names_of_the_root_alone_are_none_of_joints(tmp_path):
    path = write(tmp_path, {"timestep": 0.02, "qpos_names": NAMES[:7]}, qpos=CLIP.qpos)
    (file,) = read_motion_files(path)
    np.testing.assert_allclose(file.clips[0].qpos, CLIP.qpos, atol=1e-5)
    assert "timestep from manifest.json" in file.facts


def test_an_archive_that_states_its_rate_needs_no_manifest(tmp_path):
    path = write(tmp_path, {"timestep": 0.04}, qpos=CLIP.qpos, fps=50)
    (file,) = read_motion_files(path)
    assert (file.clips[0].fps, "manifest" in file.facts) == (50, False)


@pytest.mark.parametrize("manifest", ["{", [], {"timestep": "0.02"}, {"icons": []}])
def test_other_manifests_say_nothing(tmp_path, manifest):
    path = write(tmp_path, manifest, qpos=CLIP.qpos)
    with pytest.raises(MotionError, match="no array 'fps', expected the frames a second"):
        read_motion_files(path)
