import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import MotionClip, load_motions, read_motion_files, save_csv
from plat.robots import G1
from tests.motions.formats.writers import bowing_clip, write_csv


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_the_order_is_detected_and_told(tmp_path, order):
    clip = bowing_clip()
    write_csv(tmp_path / "bow_50fps.csv", clip, order)
    (file,) = read_motion_files(tmp_path / "bow_50fps.csv")
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-5)
    assert (file.clips[0].name, file.clips[0].fps) == ("bow", 50.0)
    assert file.facts == f"csv, 50 fps, quaternion {order} detected, fps from the file name"


def test_the_order_may_be_stated(tmp_path):
    write_csv(tmp_path / "bow.csv", bowing_clip(), "wxyz")
    wrong, right = (load_motions(tmp_path / "bow.csv", quat_order=order)[0].qpos for order in ("xyzw", "wxyz"))
    np.testing.assert_allclose(wrong[:, [6, 3, 4, 5]], right[:, [5, 6, 3, 4]], atol=1e-6)


def test_an_order_that_the_motion_does_not_show_is_asked_for(tmp_path):
    standing = MotionClip("standing", np.tile(G1.default_qpos, (30, 1)), 30.0)
    write_csv(tmp_path / "standing.csv", standing, "xyzw")
    with pytest.raises(MotionError, match=r"standing.csv.*recipes/motions.py convert .* --quat-order wxyz"):
        load_motions(tmp_path / "standing.csv")
    (clip,) = load_motions(tmp_path / "standing.csv", quat_order="xyzw")
    np.testing.assert_allclose(clip.qpos, standing.qpos, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "stated", "fps", "told"),
    [
        ("a.csv", None, 30.0, "fps assumed"),
        ("a_60fps.csv", None, 60.0, "fps from the file name"),
        ("a-29.97FPS_x.csv", None, 29.97, "fps from the file name"),
        ("a_60fps.csv", 25.0, 25.0, "quaternion"),
    ],
)
def test_frame_rate(tmp_path, name, stated, fps, told):
    write_csv(tmp_path / name, bowing_clip())
    (file,) = read_motion_files(tmp_path / name, fps=stated)
    assert file.clips[0].fps == fps
    assert told in file.facts


def test_a_header_names_joints_and_order(tmp_path):
    clip = bowing_clip()
    written = save_csv(tmp_path, clip)
    assert written.name == "bow_50fps.csv"
    lines = written.read_text().splitlines()
    columns = [0, 1, 2, 4, 5, 6, 3, *range(35, 6, -1)]  # xyzw, joints backwards
    written.write_text("\n".join(",".join(line.split(",")[column] for column in columns) for line in lines))
    (file,) = read_motion_files(written)
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-5)
    assert "quaternion xyzw as the header says" in file.facts
    assert "joints reordered by name" in file.facts


def test_a_header_without_joint_names_is_skipped(tmp_path):
    write_csv(tmp_path / "a.csv", bowing_clip())
    text = (tmp_path / "a.csv").read_text()
    (tmp_path / "a.csv").write_text(",".join(f"column {index}" for index in "ABCDEFGHI" * 4) + "\n" + text)
    assert len(load_motions(tmp_path / "a.csv")[0].qpos) == 40


def table(rows: int = 3, **cells: str) -> str:
    row = ["0", "0", "0.76", "1", "0", "0", "0", *["0"] * 29]
    for column, value in cells.items():
        row[int(column[1:])] = value
    return "\n".join([",".join(row)] * rows)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no rows of numbers"),
        (",".join(G1.joint_names), "no rows of numbers"),
        (table() + "\n1,2,3", "row 4 has 3 columns, expected 36"),
        (table() + "\n" + table().splitlines()[0] + ",0", "row 4 has 37 columns"),
        (table(c9="left"), "a cell is not a number"),
        (table(c9=""), "a cell is not a number"),
        (table(c9="nan"), r"qpos\[0, 9\] is nan"),
        (table(c3="0.5"), "quaternion of frame 0 .* has length 0.5, expected 1"),
        (table(c8="57.3"), "'joint angles' has values up to 57.3, expected radians"),
        (table(c2="1e30"), "'columns 1 to 3' has values up to 1e[+]30, expected metres"),
        (table(1), "1 frames, expected at least 2"),
        (",".join([*"xyz", *"wxyz", *G1.joint_names[:-1], "tail"]) + "\n" + table(), "has the unknown .*tail"),
    ],
)
def test_errors_name_file_and_field(tmp_path, text, message):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(MotionError, match=rf"bad.csv'.*{message}"):
        load_motions(tmp_path / "bad.csv")


def test_a_frame_rate_must_be_possible(tmp_path):
    write_csv(tmp_path / "a.csv", bowing_clip())
    for fps in (-1.0, 0.0, 5000.0, float("nan")):
        with pytest.raises(MotionError, match=f"fps is {fps:g}, expected 1 to 1000"):
            load_motions(tmp_path / "a.csv", fps=fps)
