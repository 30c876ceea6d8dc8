import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plat.errors import MotionError
from plat.motions.retargeting import read_bvh

from .human import JOINTS, write_human

TEXT = """HIERARCHY
ROOT hips
{
  OFFSET 1 2 3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT left knee
  {
    OFFSET 0 -4 0
    CHANNELS 3 Yrotation Zrotation Xrotation
    End Site
    {
      OFFSET 0 -3 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
0 10 0 0 0 0 0 0 0
5 10 0 30 20 10 40 50 60
"""


def read(tmp_path, text: str):
    (tmp_path / "clip.bvh").write_text(text, newline="")
    return read_bvh(tmp_path / "clip.bvh")


def test_joints_are_where_the_channels_put_them(tmp_path):
    bvh = read(tmp_path, TEXT)
    assert bvh.names == ("hips", "left knee", "left knee_end")
    assert (bvh.parents, bvh.fps) == ((-1, 0, 1), 100.0)
    np.testing.assert_allclose(bvh.positions[0], [[0, 10, 0], [0, 6, 0], [0, 3, 0]], atol=1e-12)
    hips = Rotation.from_euler("ZXY", [30, 20, 10], degrees=True)
    knee = hips * Rotation.from_euler("YZX", [40, 50, 60], degrees=True)
    np.testing.assert_allclose(bvh.positions[1, 1], np.add([5, 10, 0], hips.apply([0, -4, 0])), atol=1e-12)
    np.testing.assert_allclose(bvh.positions[1, 2] - bvh.positions[1, 1], knee.apply([0, -3, 0]), atol=1e-12)
    np.testing.assert_allclose(bvh.rotations[1, 1], knee.as_matrix(), atol=1e-12)


def test_position_channels_take_the_place_of_the_offset(tmp_path):
    text = TEXT.replace("CHANNELS 3 Yrotation Zrotation Xrotation", "CHANNELS 2 Yposition Zrotation")
    text = text.replace("0 0 0 0 0 0 0\n", "0 0 0 0 -9 0\n").replace("10 40 50 60", "10 -9 0")
    np.testing.assert_allclose(read(tmp_path, text).positions[0, 1], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("  ", "\t").replace(" ", " \t  "),
        lambda text: "\ufeff" + text + "\n \n",
        lambda text: text.replace("Xposition", "xposition"),
        lambda text: text.replace("HIERARCHY", "Hierarchy").replace("Frame Time", "Frame time"),
        lambda text: text.replace("Frames: 2", "Frames:2").replace("Time: 0.01", "Time:0.01"),
        lambda text: text.replace("hips\n{", "hips {").replace("-3 0\n    }", "-3 0 }"),
    ],
    ids=["CRLF", "tabs and spaces", "BOM and blank lines", "lower case", "other case", "no spaces", "braces in line"],
)
def test_ways_of_writing(tmp_path, change):
    np.testing.assert_array_equal(read(tmp_path, change(TEXT)).positions, read(tmp_path, TEXT).positions)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le"])
def test_text_as_windows_writes_it(tmp_path, encoding):
    (tmp_path / "windows.bvh").write_text(TEXT, encoding=encoding)
    np.testing.assert_array_equal(read_bvh(tmp_path / "windows.bvh").positions, read(tmp_path, TEXT).positions)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("HIERARCHY", "HIERARCHIE", "line 1: 'HIERARCHIE', expected HIERARCHY"),
        ("ROOT hips", "ROOT", "line 2: 'ROOT', expected a name"),
        ("JOINT left knee", "JOINT hips", "line 6: 'JOINT hips', expected a name that no other joint has"),
        ("OFFSET 0 -4 0", "OFFSET 0 -4", "line 8: .*expected OFFSET with three numbers"),
        ("OFFSET 0 -4 0", "OFFSET 0 x 0", "line 8: .*expected OFFSET with three numbers"),
        ("CHANNELS 3", "CHANNELS 4", "line 9: .*expected CHANNELS, their number"),
        ("Yrotation Zrotation Xrotation", "Yrotation Zrotation Wrotation", "line 9: .*expected CHANNELS"),
        ("MOTION", "}", "line 16: '}', expected ROOT"),
        ("Frames: 2", "Frames: -2", "line 17: .*a positive number"),
        ("Frame Time: 0.01", "Frame Time: x", "line 18: .*positive seconds"),
        ("Frame Time: 0.01", "Frame Time: 0", "line 18: .*positive seconds"),
        ("40 50 60", "40 50", "line 20: .*9 finite numbers, one a channel, found 8"),
        ("40 50 60", "40 50 nan", "line 20: .*9 finite numbers, one a channel, found 'nan'"),
        ("40 50 60", "40 50 6,0", "line 20: .*9 finite numbers, one a channel, found '6,0'"),
    ],
)
def test_errors_name_file_and_line(tmp_path, old, new, message):
    with pytest.raises(MotionError, match=f"clip.bvh'.*{message}"):
        read(tmp_path, TEXT.replace(old, new, 1))


def test_missing_file():
    with pytest.raises(MotionError, match=r"'nowhere.bvh': cannot be read"):
        read_bvh("nowhere.bvh")


@pytest.mark.parametrize("told", [1, 3, 99999999999999])
def test_the_frames_that_are_there_count(tmp_path, told):
    mocap = read(tmp_path, TEXT.replace("Frames: 2", f"Frames: {told}"))
    np.testing.assert_array_equal(mocap.positions, read(tmp_path, TEXT).positions)
    assert mocap.notes == (f"2 frames, for 'Frames:' says {told}",)
    assert read(tmp_path, TEXT).notes == ()


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ("33.3333", "33.3333 s is 0.03 frames a second, expected 8 to 1000 .30 if it is in milliseconds"),
        ("30", "30 if it is the rate itself.; state it: plat motions convert --fps"),
        ("1.0", "1 s is 1 frames a second"),
        ("8333.3", "120 if it is in microseconds"),
        ("1e-6", "1e[+]06 frames a second"),
        ("0", "positive seconds .or state the rate: plat motions convert --fps."),
        ("-0.01", "positive seconds"),
        ("nan", "positive seconds"),
    ],
)
def test_a_frame_time_that_no_capture_has_is_refused(tmp_path, told, message):
    text = TEXT.replace("Frame Time: 0.01", f"Frame Time: {told}")
    with pytest.raises(MotionError, match=message):
        read(tmp_path, text)
    assert read_bvh(tmp_path / "clip.bvh", fps=60).fps == 60


def test_every_truncation_is_noticed(tmp_path):
    # a cut within the last number leaves a number, and nothing can tell
    for length in range(0, len(TEXT.rstrip()) - 1, 4):
        try:
            mocap = read(tmp_path, TEXT[:length])
        except MotionError:
            continue
        assert mocap.notes == ("1 frame, for 'Frames:' says 2",)


def test_damaged_files_are_read_or_refused(tmp_path):
    content = bytearray(write_human(tmp_path / "human.bvh", frames=2).read_bytes())
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(100):
        damaged = content.copy()
        for place in rng.integers(len(content), size=3):
            damaged[place] = rng.integers(256)
        (tmp_path / "bad.bvh").write_bytes(damaged)
        try:
            read_bvh(tmp_path / "bad.bvh")
        except MotionError:
            refused += 1
    assert refused > 50


def test_joints_that_do_not_move_take_no_memory(tmp_path):
    joints = "".join(f"JOINT j{index} {{\nOFFSET 0 1 0\n" for index in range(500))
    head = f"HIERARCHY\nROOT a {{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n{joints}{'} ' * 501}\nMOTION\n"
    text = head + "Frames: 2000\nFrame Time: 0.01\n" + "0\n" * 2000
    with pytest.raises(MotionError, match=r"clip.bvh': 501 joints over 2000 frames in 0.\d+ MB: most of them do not"):
        read(tmp_path, text)


def test_more_joints_than_any_body_has(tmp_path):
    joints = "".join(f"JOINT j{index} {{\nOFFSET 0 1 0\n" for index in range(2000))
    text = f"HIERARCHY\nROOT a {{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n{joints}{'} ' * 2001}\nMOTION\n"
    with pytest.raises(MotionError, match="clip.bvh': 2001 joints, expected at most 2000"):
        read(tmp_path, text + "Frames: 1\nFrame Time: 0.01\n0\n")


def test_angles_in_radians_are_seen(tmp_path):
    path = write_human(tmp_path / "a.bvh", turns={"LeftArm": (40, 0, 0)})
    head, rows = path.read_text().split("Frame Time: 0.033333\n")
    values = np.array([[float(word) for word in row.split()] for row in rows.splitlines()])
    values[:, 3:] = np.deg2rad(values[:, 3:])
    (tmp_path / "b.bvh").write_text(
        f"{head}Frame Time: 0.033333\n" + "\n".join(" ".join(map(str, row)) for row in values)
    )
    found, expected = read_bvh(tmp_path / "b.bvh"), read_bvh(path)
    np.testing.assert_allclose(found.positions, expected.positions, atol=1e-3)
    assert found.notes == ("angles in radians: in degrees nobody stands or moves so",)
    assert expected.notes == ()


def test_a_rest_pose_is_in_degrees(tmp_path):
    path = write_human(tmp_path / "a.bvh")
    head, rows = path.read_text().split("Frame Time: 0.033333\n")
    still = "\n".join(" ".join(row.split()[:3] + ["0"] * (len(row.split()) - 3)) for row in rows.splitlines())
    (tmp_path / "b.bvh").write_text(f"{head}Frame Time: 0.033333\n{still}")
    assert read_bvh(tmp_path / "b.bvh").notes == ()


WALKER = """HIERARCHY
ROOT hips
{
OFFSET 0 0 0
CHANNELS 6 Xposition Yposition Zposition Xrotation Yrotation Zrotation
JOINT chest {
OFFSET 0 50 0
CHANNELS 1 Xrotation
End Site {
OFFSET 0 30 0
} }
JOINT left {
OFFSET 10 0 0
CHANNELS 1 Xrotation
End Site {
OFFSET 0 -90 0
} }
JOINT right {
OFFSET -10 0 0
CHANNELS 1 Xrotation
End Site {
OFFSET 0 -90 0
} }
}
MOTION
"""


def write_walker(path, swing: float, *, scale: float, walks: bool) -> Path:
    """Write someone on stiff legs that swing by some degrees, in numbers of which one is so many degrees.

    With ``walks`` the hips go where the standing foot wants them, else they stay.
    """
    angles = np.deg2rad(swing) * np.sin(np.arange(90) / 8)
    rows, z = [], 0.0
    for frame, angle in enumerate(angles):
        if frame and walks:
            z += 90 * abs(np.sin(angle) - np.sin(angles[frame - 1]))
        turn = np.rad2deg(angle) / scale
        rows.append(f"0 {90 * np.cos(angle) if walks else 90} {z:.6f} {0.6 / scale} 0 0 0 {turn:.6f} {-turn:.6f}")
    path.write_text(WALKER + f"Frames: {len(rows)}\nFrame Time: 0.033333\n" + "\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("largest", [0.6, 1.5, 2.4, 6.0])
def test_small_motion_is_in_degrees_as_the_format_has_it(tmp_path, largest):
    quiet = read_bvh(write_walker(tmp_path / "a.bvh", largest, scale=1.0, walks=False))
    told = f"{max(largest * np.sin(np.arange(90) / 8).max(), 0.6):.2g}"
    assert quiet.notes == (
        f"angles in degrees, as BVH has them, though none is above {told} (else: plat motions convert --angles)",
    )
    assert np.abs(quiet.positions - quiet.positions[:1]).max() < 10


def test_who_walks_in_radians_alone_has_angles_in_radians(tmp_path):
    expected = read_bvh(write_walker(tmp_path / "a.bvh", 35, scale=1.0, walks=True))
    found = read_bvh(write_walker(tmp_path / "b.bvh", 35, scale=np.rad2deg(1), walks=True))
    assert (expected.notes, found.notes) == ((), ("angles in radians: in degrees nobody stands or moves so",))
    np.testing.assert_allclose(found.positions, expected.positions, atol=1e-3)


def test_the_unit_that_is_stated_counts(tmp_path):
    path = write_walker(tmp_path / "a.bvh", 2.0, scale=1.0, walks=False)
    radians = read_bvh(path, angles="radians")
    assert radians.notes == ()
    assert np.abs(radians.positions - radians.positions[:1]).max() > 50
    path = write_walker(tmp_path / "b.bvh", 35, scale=np.rad2deg(1), walks=True)
    assert read_bvh(path, angles="degrees").notes == ()


def test_radians_of_whole_turns_are_radians(tmp_path):
    """Angles that jump by a turn, as those beyond half of one do in some files, are the same rotation."""
    path = write_walker(tmp_path / "a.bvh", 35, scale=np.rad2deg(1), walks=True)
    head, rows = path.read_text().split("0.033333\n")
    values = np.array([[float(word) for word in row.split()] for row in rows.splitlines()])
    values[:, 3:] %= 2 * np.pi
    jumping = "\n".join(" ".join(f"{value:.6f}" for value in row) for row in values)
    (tmp_path / "b.bvh").write_text(f"{head}0.033333\n{jumping}")
    found = read_bvh(tmp_path / "b.bvh")
    np.testing.assert_allclose(found.positions, read_bvh(path).positions, atol=1e-3)


@pytest.mark.parametrize("commas", [True, False])
def test_decimal_commas_and_a_unit_of_the_frame_time(tmp_path, commas):
    path = write_human(tmp_path / "a.bvh", frames=5)
    usual, text = read_bvh(path), path.read_text()
    path.write_text(text.replace(".", ",") if commas else re.sub(r"(Frame Time: \S+)", r"\1 s", text))
    mocap = read_bvh(path)
    assert mocap.fps == usual.fps
    np.testing.assert_array_equal(mocap.positions, usual.positions)
    assert mocap.notes == (("decimal commas",) if commas else ())


def test_of_two_people_one_is_read_and_told(tmp_path):
    names = [{joint: f"{who}:{joint}" for joint, *_ in JOINTS} for who in ("A", "B")]
    files = [write_human(tmp_path / "a.bvh", frames=3, names=of).read_text().split("MOTION\n") for of in names]
    rows = [motion.splitlines() for _, motion in files]
    both = [*rows[0][:2], *(" ".join(row) for row in zip(rows[0][2:], rows[1][2:], strict=True))]
    tree = files[0][0] + files[1][0].removeprefix("HIERARCHY\n")
    (tmp_path / "two.bvh").write_text(tree + "MOTION\n" + "\n".join(both))
    assert read_bvh(tmp_path / "two.bvh").notes == ("one of 2 skeletons in the file",)
    assert read_bvh(tmp_path / "a.bvh").notes == ()


@pytest.mark.parametrize(
    ("written", "rate"),
    [("0.017", 60), ("0.0166", 60), ("0.033", 30), ("0.0083", 120), ("0.042", 24)],
)
def test_a_rounded_frame_time_is_that_of_a_usual_rate(tmp_path, written, rate):
    bvh = read(tmp_path, TEXT.replace("Frame Time: 0.01", f"Frame Time: {written}"))
    assert bvh.fps == rate
    assert f"{rate} fps assumed for the rounded 'Frame Time' {written}" in bvh.notes


@pytest.mark.parametrize(("written", "rate"), [("0.008", 125), ("0.016", 62.5), ("0.033367", 29.97), ("0.02", 50)])
def test_a_frame_time_that_is_not_rounded_is_as_it_says(tmp_path, written, rate):
    bvh = read(tmp_path, TEXT.replace("Frame Time: 0.01", f"Frame Time: {written}"))
    assert (bvh.fps, bvh.notes) == (pytest.approx(rate, rel=1e-4), ())
