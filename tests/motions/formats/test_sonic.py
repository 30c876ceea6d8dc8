import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import load_motions, motion_paths, read_motion_files
from plat.motions.files import read_along
from plat.robots import G1

from .writers import ISAAC_ORDER, body_poses, bowing_clip


def write(folder, clip, bodies=None):
    """Write a folder as SONIC has it; ``bodies`` are those that it records."""
    folder.mkdir()
    pos, quat = (poses[:, bodies or slice(None)] for poses in body_poses(clip))
    joints = clip.qpos[:, [7 + G1.joint_names.index(name) for name in ISAAC_ORDER]]
    tables = {"joint_pos": (joints, "joint_{}"), "joint_vel": (0 * joints, "joint_vel_{}")}
    tables |= {"body_pos": (pos, "body_{}"), "body_quat": (quat, "body_{}"), "body_lin_vel": (0 * pos, "body_{}_vel")}
    for name, (values, spelled) in tables.items():
        rows = values.reshape(len(values), -1)
        header = ",".join(spelled.format(column) for column in range(rows.shape[1]))
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="", fmt="%.7g")
    return folder


@pytest.mark.parametrize("bodies", [None, [0]], ids=["bodies", "root"])
def test_a_folder_is_a_motion(tmp_path, bodies):
    clip = bowing_clip(heading=0.7)
    write(tmp_path / "bow_A464", clip, bodies)
    (file,) = read_motion_files(tmp_path)
    assert [found.name for found in file.clips] == ["bow_A464"]
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-5)
    assert file.facts.startswith("SONIC csv, 50 fps, fps as SONIC has it")


def test_a_rate_in_the_folders_name_beats_the_usual_one(tmp_path):
    (file,) = read_motion_files(write(tmp_path / "bow_30fps", bowing_clip()))
    assert file.clips[0].fps == 30
    assert "fps from the folder's name" in file.facts


def test_what_belongs_to_a_motion_is_no_motion(tmp_path):
    folder = write(tmp_path / "bow", bowing_clip())
    assert motion_paths(tmp_path) == [folder / "joint_pos.csv"]
    assert motion_paths(folder / "joint_vel.csv") == [folder / "joint_vel.csv"]
    assert {path.name for path in read_along(folder / "joint_pos.csv")} == {"body_pos.csv", "body_quat.csv"}


def test_tables_that_do_not_fit_are_refused(tmp_path):
    folder = write(tmp_path / "bow", bowing_clip())
    lines = (folder / "body_pos.csv").read_text().splitlines()
    (folder / "body_pos.csv").write_text("\n".join(lines[:-1]))
    with pytest.raises(MotionError, match="'body_pos.csv' beside it has 39 rows of .* expected 40 rows of 3 for each"):
        load_motions(folder)
