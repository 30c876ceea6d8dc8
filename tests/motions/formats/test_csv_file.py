import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from plat.errors import MotionError
from plat.motions import MotionClip, generate_motions, load_motions, read_motion_files, save_csv, validate_motion
from plat.motions.formats.columns import place_first
from plat.motions.resample import resample_qpos
from plat.robots import G1
from plat.rotations_np import quat_multiply
from tests.motions.formats.writers import ISAAC_ORDER, WITHOUT_WRISTS, bowing_clip, turned, write_csv, write_plat


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
    with pytest.raises(MotionError, match=r"standing.csv.*plat motions convert .* --quat-order wxyz"):
        load_motions(tmp_path / "standing.csv")
    (clip,) = load_motions(tmp_path / "standing.csv", quat_order="xyzw")
    np.testing.assert_allclose(clip.qpos, standing.qpos, atol=1e-5)
    write_csv(tmp_path / "still life.csv", standing, "xyzw")
    with pytest.raises(MotionError, match=r" convert '[^']*/still life.csv' --quat-order wxyz --out 'still life.npz' "):
        load_motions(tmp_path / "still life.csv")


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
        ("", "it is empty"),
        ("\n \n", "no rows of numbers"),
        (",".join(G1.joint_names), "no rows of numbers"),
        (table() + "\n1,2,3", "row 4 has 3 columns, row 1 has 36"),
        (table() + "\n" + table().splitlines()[0] + ",0", "row 4 has 37 columns"),
        (table() + ",0", "row 3 has 37 columns, row 1 has 36"),
        ("\n".join(f"{line},0,0" for line in table().splitlines()), "row 1 has 38 columns, expected 36"),
        (table(c9="left"), "row 1, column 10: 'left' is not a number"),
        (table(c9=""), "row 1, column 10 is empty, expected a number"),
        (table(c9="nan"), r"qpos\[0, 9\] is nan"),
        (table(c3="0.5"), "quaternion of frame 0 .* has length 0.5, expected 1"),
        (table(c8="573"), "'joint angles' has values up to 573, expected radians"),
        (table(c2="1e30"), "'root position' has values up to 1e[+]30, expected meters"),
        (table(1), "1 frame, expected at least 2"),
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
        with pytest.raises(MotionError, match=f"fps is {fps}, expected a number from 1 to 1,000"):
            load_motions(tmp_path / "a.csv", fps=fps)
    write_csv(tmp_path / "a_5000fps.csv", bowing_clip())
    with pytest.raises(MotionError, match="fps is 5000, expected 1 to 1000"):
        load_motions(tmp_path / "a_5000fps.csv")


NAMES = [*(f"root_{axis}" for axis in "xyz"), *(f"quat_{axis}" for axis in "wxyz"), *G1.joint_names]


def write_table(path, values, header=None, separator=","):
    rows = [separator.join(f"{value:.8g}" for value in row) for row in values]
    path.write_text("\n".join(([separator.join(header)] if header else []) + rows))


def read_back(path, **stated):
    (file,) = read_motion_files(path, **stated)
    return file, file.clips[0]


@pytest.mark.parametrize("spell", [str.upper, lambda name: f"{name}_joint_pos", lambda name: f"joint/{name}"])
def test_names_are_never_passed_over(tmp_path, spell):
    clip = bowing_clip()
    header = [*NAMES[:7], *map(spell, reversed(G1.joint_names))]
    write_table(tmp_path / "a_50fps.csv", clip.qpos[:, [*range(7), *range(35, 6, -1)]], header)
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert "joints reordered by name" in file.facts


def test_names_that_are_not_understood_are_refused(tmp_path):
    header = [*NAMES[:7], *(f"hinge {name[::-1]}" for name in G1.joint_names)]
    write_table(tmp_path / "a_50fps.csv", bowing_clip().qpos, header)
    with pytest.raises(
        MotionError, match=r"the header has the unknown \['hinge .*expected names of the robot's joints"
    ):
        load_motions(tmp_path / "a_50fps.csv")


def test_columns_may_stand_anywhere(tmp_path):
    clip = bowing_clip()
    shuffled = np.random.default_rng(0).permutation(36)
    header = ["Frame", *(NAMES[column] for column in shuffled), "left_knee_vel", "style"]
    extra = np.full((40, 1), 3.0)
    write_table(
        tmp_path / "a_50fps.csv", np.hstack((np.arange(40)[:, None], clip.qpos[:, shuffled], extra, extra)), header
    )
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert "2 columns left out ('left_knee_vel', 'style')" in file.facts


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize(
    ("first", "name", "rate"), [("index", "", 30), ("time", "time", 50), ("time", "timestamp_ms", 50)]
)
def test_a_first_column_that_counts(tmp_path, named, first, name, rate):
    clip = bowing_clip()
    column = np.arange(40) * (1 if first == "index" else 20 if name.endswith("ms") else 0.02)
    values = np.hstack((column[:, None], clip.qpos))
    write_table(tmp_path / "a.csv", values, [name, *NAMES] if named else None)
    file, found = read_back(tmp_path / "a.csv")
    assert found.fps == rate
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert ("fps from the column of times" in file.facts) == (first == "time")


COUNT = np.arange(40)
CLOCKS = {
    "sim_time": {"sim_time": COUNT / 50},
    "ros_time": {"ros_time": 7 + COUNT / 50},
    "time_since_start": {"time_since_start": COUNT / 50},
    "motion_time": {"motion_time": COUNT / 50},
    "stamps of ROS": {"header.seq": COUNT, "header.stamp.sec": 7 + COUNT // 50, "header.stamp.nanosec": COUNT * 2e7},
    "a topic of ROS": {"%time": COUNT * 2e7, "field.header.seq": COUNT},
    "PlotJuggler": {"__time": 7 + COUNT / 50},
    "fps": {"frame": COUNT, "fps": np.full(40, 50)},
    "another unit": {"time [s]": COUNT * 20},
    "dt": {"dt": np.full(40, 0.02)},
    "a clock on a wall": {"wall_time": COUNT / 40 + 0.002 * np.sin(COUNT), "sim_time": COUNT / 50},
    "clip_frame": {"clip_frame": COUNT},
    "episode_step": {"episode_step": COUNT + 7},
    "motion_phase": {"motion_phase": COUNT / 39},
}


@pytest.mark.parametrize("columns", CLOCKS.values(), ids=CLOCKS)
def test_clocks_and_counts_by_their_names(tmp_path, columns):
    clip = bowing_clip()
    write_table(tmp_path / "a.csv", np.column_stack((*columns.values(), clip.qpos)), [*columns, *NAMES])
    file, found = read_back(tmp_path / "a.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    if {"clip_frame", "episode_step", "motion_phase"} & set(columns):
        assert any("fps assumed" in note for note in found.notes)
    else:
        assert found.fps == 50
        assert "fps from 'fps'" in file.facts or "fps from the column of times" in file.facts
        assert (", which is not in s" in file.facts) == ("time [s]" in columns)


def test_numbers_as_header(tmp_path):
    write_table(tmp_path / "a_50fps.csv", bowing_clip().qpos, [str(number) for number in range(36)])
    np.testing.assert_allclose(read_back(tmp_path / "a_50fps.csv")[1].qpos, bowing_clip().qpos, atol=1e-5)


def seed_columns(clip):
    """Columns as BONES-SEED has them: frame, cm, Euler angles about fixed axes in degrees, joints in degrees."""
    turns = Rotation.from_quat(clip.qpos[:, [4, 5, 6, 3]]).as_euler("xyz", degrees=True)
    columns = (np.arange(len(turns))[:, None], 100 * clip.qpos[:, :3], turns, np.rad2deg(clip.qpos[:, 7:]))
    roots = [f"root_{what}{axis}" for what in ("translate", "rotate") for axis in "XYZ"]
    return np.hstack(columns), ["Frame", *roots, *(f"{name}_joint_dof" for name in G1.joint_names)]


def test_bones_seed(tmp_path):
    clip = turned(bowing_clip(), 2.0)
    write_table(tmp_path / "bow__A304.csv", *seed_columns(clip))
    file, found = read_back(tmp_path / "bow__A304.csv")
    np.testing.assert_allclose(
        found.qpos[:, [0, 1, 2, *range(7, 36)]], clip.qpos[:, [0, 1, 2, *range(7, 36)]], atol=1e-4
    )
    assert np.abs((found.qpos[:, 3:7] * clip.qpos[:, 3:7]).sum(1)).min() > 1 - 1e-6
    assert file.facts.startswith(
        "BONES-SEED csv, 120 fps, fps from the format, root rotation from Euler angles in degrees"
    )


def test_root_angles_in_radians(tmp_path):
    clip = turned(bowing_clip(), 0.5)
    turns = Rotation.from_quat(clip.qpos[:, [4, 5, 6, 3]]).as_euler("xyz")
    header = [*NAMES[:3], "roll", "pitch", "yaw", *G1.joint_names]
    write_table(tmp_path / "a_50fps.csv", np.hstack((clip.qpos[:, :3], turns, clip.qpos[:, 7:])), header)
    file, found = read_back(tmp_path / "a_50fps.csv")
    assert np.abs((found.qpos[:, 3:7] * clip.qpos[:, 3:7]).sum(1)).min() > 1 - 1e-6
    assert "root rotation from Euler angles in radians" in file.facts
    with pytest.raises(MotionError, match="a_50fps.csv': quat_order is stated, and says nothing about a csv"):
        load_motions(tmp_path / "a_50fps.csv", quat_order="xyzw")
    write_csv(tmp_path / "b_50fps.csv", clip, "xyzw")
    for both in load_motions(tmp_path, quat_order="xyzw"):
        assert np.abs((both.qpos[:, 3:7] * clip.qpos[:, 3:7]).sum(1)).min() > 1 - 1e-6


@pytest.mark.parametrize(("factor", "unit"), [(100, "centimeters"), (1000, "millimeters")])
def test_other_units_are_seen(tmp_path, factor, unit):
    clip = bowing_clip()
    write_table(tmp_path / "a_50fps.csv", clip.qpos * np.array([factor] * 3 + [1] * 33))
    _, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert f"root position in {unit}" in found.notes[0]


def test_joints_as_isaac_lab_numbers_them(tmp_path):
    clip = bowing_clip()
    columns = [*range(7), *(7 + G1.joint_names.index(name) for name in ISAAC_ORDER)]
    write_table(tmp_path / "a_50fps.csv", clip.qpos[:, columns])
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert "joints numbered breadth first" in file.facts


@pytest.mark.parametrize("named", [True, False])
def test_23_joints(tmp_path, named):
    clip = bowing_clip()
    columns = [*range(7), *(7 + index for index in WITHOUT_WRISTS)]
    write_table(
        tmp_path / "a_50fps.csv", clip.qpos[:, columns], [NAMES[column] for column in columns] if named else None
    )
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos[:, columns], clip.qpos[:, columns], atol=1e-5)
    assert "no wrists in the file: default pose" in file.facts


def test_a_header_whose_quaternion_order_is_wrong(tmp_path):
    clip = bowing_clip(heading=0.7)
    header = [*NAMES[:3], *(f"quat_{axis}" for axis in "xyzw"), *G1.joint_names]
    write_table(tmp_path / "a_50fps.csv", clip.qpos, header)
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert "quaternion wxyz: xyzw, as it should be, makes no plausible motion" in file.facts


@pytest.fixture(scope="module")
def walk() -> MotionClip:
    return next(clip for clip in generate_motions("train", seconds=20) if clip.name.startswith("walk_"))


@pytest.mark.parametrize("name", ["walk_{0}hz", "walk_fps{0}", "walk_{0}_fps", "walk @{0}"])
def test_rates_in_the_name(tmp_path, walk, name):
    path = tmp_path / f"{name.format(f'{walk.fps:g}')}.csv"
    write_table(path, walk.qpos)
    file, found = read_back(path)
    assert (found.fps, found.name) == (walk.fps, "walk")
    assert "fps from the file name" in file.facts


def test_two_rates_in_the_name_are_settled_by_the_steps_or_refused(tmp_path, walk):
    for names in ("{0}fps_walk_{1}fps", "{1}fps_to_{0}fps"):
        path = tmp_path / f"{names.format(f'{walk.fps:g}', f'{4 * walk.fps:g}')}.csv"
        write_table(path, walk.qpos)
        file, found = read_back(path)
        assert found.fps == walk.fps
        assert "the one that fits its steps" in file.facts
    path = tmp_path / "bow_120fps_to_30fps.csv"
    write_table(path, bowing_clip().qpos)
    with pytest.raises(
        MotionError, match="states 120 .the file name. and 30 .the file name. frames a second; state which"
    ):
        load_motions(path)
    assert load_motions(path, fps=30)[0].fps == 30


def test_a_rate_that_nothing_states_must_fit_the_steps(tmp_path, walk):
    qpos = resample_qpos(torch.from_numpy(walk.qpos), walk.fps, 1 / 120).numpy()
    write_table(tmp_path / "walk.csv", qpos)
    with pytest.raises(MotionError, match="nothing states its frames a second; the usual 30 do not fit its steps"):
        load_motions(tmp_path / "walk.csv")
    assert load_motions(tmp_path / "walk.csv", fps=120)[0].fps == 120


def test_rates_that_contradict_each_other(tmp_path):
    values = np.hstack((np.arange(40)[:, None] / 50, bowing_clip().qpos))
    write_table(tmp_path / "bow_30fps.csv", values, ["time", *NAMES])
    with pytest.raises(MotionError, match="states 50 .the column of times. and 30 .the file name."):
        load_motions(tmp_path / "bow_30fps.csv")


def test_velocities_after_the_pose_are_left_out(tmp_path):
    clip = bowing_clip()
    write_table(tmp_path / "a_50fps.csv", np.hstack((clip.qpos, np.zeros((40, 35)))))
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert "the last 35 columns left out (velocities)" in file.facts


def test_one_joint_that_is_not_understood_is_named(tmp_path):
    header = [*NAMES]
    header[NAMES.index("left_knee")] = "LeftHandle"
    write_table(tmp_path / "a_50fps.csv", bowing_clip().qpos, header)
    with pytest.raises(MotionError, match="the header has the unknown .'LeftHandle'. and lacks the joints .'left_k"):
        load_motions(tmp_path / "a_50fps.csv")


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_a_table_whose_y_axis_is_up(tmp_path, order):
    clip = bowing_clip(heading=0.7)
    half = np.sqrt(0.5)
    quat = quat_multiply(np.tile([half, -half, 0, 0], (40, 1)), clip.qpos[:, 3:7])
    quat = quat if order == "wxyz" else quat[:, [1, 2, 3, 0]]
    values = np.hstack((clip.qpos[:, [0, 2]], -clip.qpos[:, 1:2], quat, clip.qpos[:, 7:]))
    write_table(tmp_path / "a_50fps.csv", values)
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert "y axis up in the file, turned to z" in file.facts
    assert f"quaternion {order} detected" in file.facts


def test_degrees(tmp_path):
    clip = bowing_clip()
    write_table(tmp_path / "a_50fps.csv", np.hstack((clip.qpos[:, :7], np.rad2deg(clip.qpos[:, 7:]))))
    np.testing.assert_allclose(read_back(tmp_path / "a_50fps.csv")[1].qpos, clip.qpos, atol=1e-5)


def with_units(place: str = "m", joints: str = "rad") -> list[str]:
    """The header of a table that states its units."""
    return [
        *(f"{name} [{place}]" for name in NAMES[:3]),
        *NAMES[3:7],
        *(f"{name} [{joints}]" for name in G1.joint_names),
    ]


@pytest.mark.parametrize("actual", ["rad", "deg"])
@pytest.mark.parametrize("stated", ["rad", "deg"])
def test_the_unit_of_joints_in_a_header_is_checked(tmp_path, stated, actual):
    clip = bowing_clip()
    joints = np.rad2deg(clip.qpos[:, 7:]) if actual == "deg" else clip.qpos[:, 7:]
    write_table(tmp_path / "a_50fps.csv", np.hstack((clip.qpos[:, :7], joints)), with_units(joints=stated))
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert ("though the file says degrees" in file.facts) == ((stated, actual) == ("deg", "rad"))


def test_joints_in_two_units(tmp_path):
    clip = bowing_clip()
    header = [name.replace("[rad]", "[deg]") if "hip" in name or "knee" in name else name for name in with_units()]
    values = [
        np.rad2deg(column) if "[deg]" in name else column for name, column in zip(header, clip.qpos.T, strict=True)
    ]
    write_table(tmp_path / "a_50fps.csv", np.column_stack(values), header)
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert "some joint angles in degrees, as the header says" in file.facts


def test_an_infinite_angle_is_named(tmp_path):
    qpos = bowing_clip().qpos.copy()
    qpos[5, 10] = np.inf
    write_table(tmp_path / "a_50fps.csv", qpos)
    with pytest.raises(MotionError, match=r"qpos\[5, 10\] is inf, expected a finite number"):
        load_motions(tmp_path / "a_50fps.csv")


def test_small_angles_in_degrees_stay_degrees(tmp_path):
    clip = bowing_clip()
    qpos = clip.qpos.copy()
    qpos[:, 7:] = np.deg2rad(0.6 * np.sin(np.linspace(0, 6, len(qpos))))[:, None]
    values = np.hstack((qpos[:, :7], np.rad2deg(qpos[:, 7:])))
    write_table(tmp_path / "a_50fps.csv", values, with_units(joints="deg"))
    np.testing.assert_allclose(read_back(tmp_path / "a_50fps.csv")[1].qpos, qpos, atol=1e-5)


@pytest.mark.parametrize(("actual", "factor"), [("m", 1), ("cm", 100), ("mm", 1000)])
@pytest.mark.parametrize("stated", ["m", "cm", "mm"])
def test_the_unit_of_places_in_a_header_is_checked(tmp_path, stated, actual, factor):
    clip = bowing_clip()
    values = np.hstack((factor * clip.qpos[:, :3], clip.qpos[:, 3:]))
    write_table(tmp_path / "a_50fps.csv", values, with_units(stated))
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    told = {"m": "meters", "cm": "centimeters", "mm": "millimeters"}[actual]
    assert stated == actual or f"root position in {told}" in file.facts
    assert ("though the file says" in file.facts) == (stated != actual == "m")


def test_the_unit_in_a_header_counts_where_the_robot_does_not_stand(tmp_path):
    clip = bowing_clip()
    qpos = clip.qpos.copy()
    qpos[:, 2] = 0.15  # lies: in no unit does it stand
    write_table(tmp_path / "a_50fps.csv", np.hstack((100 * qpos[:, :3], qpos[:, 3:])), with_units("cm"))
    _, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, qpos, atol=1e-5)
    assert "root position in cm, as the file says" in found.notes


@pytest.mark.parametrize("actual", ["rad", "deg"])
@pytest.mark.parametrize("stated", ["rad", "deg"])
def test_the_unit_of_root_angles_in_a_header_is_checked(tmp_path, stated, actual):
    clip = turned(bowing_clip(), 0.5)
    turns = Rotation.from_quat(clip.qpos[:, [4, 5, 6, 3]]).as_euler("xyz", degrees=actual == "deg")
    header = [*NAMES[:3], *(f"{name} [{stated}]" for name in ("roll", "pitch", "yaw")), *G1.joint_names]
    write_table(tmp_path / "a_50fps.csv", np.hstack((clip.qpos[:, :3], turns, clip.qpos[:, 7:])), header)
    file, found = read_back(tmp_path / "a_50fps.csv")
    assert np.abs((found.qpos[:, 3:7] * clip.qpos[:, 3:7]).sum(1)).min() > 1 - 1e-6
    assert f"root rotation from Euler angles in {'radians' if actual == 'rad' else 'degrees'}" in file.facts


def write_commented(path, values, *comments, header=None):
    """Write a table with comments before it."""
    write_table(path, values, header)
    path.write_text("".join(f"# {line}\n" for line in comments) + path.read_text())


@pytest.mark.parametrize("header", [None, NAMES])
@pytest.mark.parametrize(
    "comments", [("root position in cm, angles in rad",), ("Units: cm, rad",), ("positions [cm]", "feet: flat")]
)
def test_the_unit_in_a_comment_counts_where_the_robot_does_not_stand(tmp_path, comments, header):
    qpos = bowing_clip().qpos.copy()
    qpos[:, 2] = 0.15
    write_commented(tmp_path / "a_50fps.csv", np.hstack((100 * qpos[:, :3], qpos[:, 3:])), *comments, header=header)
    _, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, qpos, atol=1e-5)
    assert "root position in cm, as the file says" in found.notes


@pytest.mark.parametrize("header", [None, NAMES])
def test_small_angles_in_degrees_by_a_comment(tmp_path, header):
    qpos = bowing_clip().qpos.copy()
    qpos[:, 7:] = np.deg2rad(0.6 * np.sin(np.linspace(0, 6, len(qpos))))[:, None]
    values = np.hstack((qpos[:, :7], np.rad2deg(qpos[:, 7:])))
    write_commented(tmp_path / "a_50fps.csv", values, "units: m, deg", header=header)
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, qpos, atol=1e-5)
    assert "joint angles in degrees" in file.facts


@pytest.mark.parametrize("header", [None, NAMES])
def test_what_the_motion_shows_beats_the_units_in_a_comment(tmp_path, header):
    clip = bowing_clip()
    write_commented(tmp_path / "a_50fps.csv", clip.qpos, "root position in cm, angles in degrees", header=header)
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert "root position in meters, though the file says cm" in file.facts
    assert "joint angles in radians, though the file says degrees" in file.facts


def test_a_header_beats_a_comment(tmp_path):
    qpos = bowing_clip().qpos.copy()
    qpos[:, 2] = 0.15
    values = np.hstack((1000 * qpos[:, :3], qpos[:, 3:]))
    write_commented(tmp_path / "a_50fps.csv", values, "units: cm", header=with_units("mm"))
    np.testing.assert_allclose(read_back(tmp_path / "a_50fps.csv")[1].qpos, qpos, atol=1e-5)


def test_root_angles_in_degrees_by_a_comment(tmp_path):
    clip = turned(bowing_clip(), 0.01)
    turns = Rotation.from_quat(clip.qpos[:, [4, 5, 6, 3]]).as_euler("xyz", degrees=True)
    header = [*NAMES[:3], "roll", "pitch", "yaw", *G1.joint_names]
    values = np.hstack((clip.qpos[:, :3], turns / 20, clip.qpos[:, 7:]))  # in radians as plausible as in degrees
    write_commented(tmp_path / "a_50fps.csv", values, "angles of the root in degrees", header=header)
    file, _ = read_back(tmp_path / "a_50fps.csv")
    assert "root rotation from Euler angles in degrees" in file.facts
    assert "joint angles" not in file.facts, "the comment is of the root alone"


@pytest.mark.parametrize("empty", ["", "-"])
def test_a_row_of_units_in_a_comment_hides_no_names(tmp_path, empty):
    clip = bowing_clip()
    names = ",".join([*NAMES[:7], *reversed(G1.joint_names)])
    units = ",".join([*["m"] * 3, *[empty] * 4, *["rad"] * 29])
    values = np.hstack((clip.qpos[:, :7], clip.qpos[:, :6:-1]))
    write_commented(tmp_path / "a_50fps.csv", values, names, units)
    file, found = read_back(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
    assert "joints reordered by name" in file.facts


def right_first(clip: MotionClip) -> MotionClip:
    """The clip with its columns as a program lists them that begins with the right side."""
    other = {"left": "right", "right": "left"}
    names = [name.split("_", 1) for name in G1.joint_names]
    columns = [G1.joint_names.index("_".join((other.get(side, side), *rest))) for side, *rest in names]
    return MotionClip(clip.name, clip.qpos[:, [*range(7), *(7 + column for column in columns)]], clip.fps)


@pytest.mark.parametrize("named", [False, True])
def test_the_right_side_may_come_first(tmp_path, named):
    # arms of the bow hang out by 0.2 rad and more; legs are set apart
    clip = bowing_clip(heading=0.7)
    for side, sign in (("left", 1), ("right", -1)):
        clip.qpos[:, 7 + G1.joint_names.index(f"{side}_hip_roll")] += 0.1 * sign
        clip.qpos[:, 7 + G1.joint_names.index(f"{side}_ankle_roll")] -= 0.1 * sign
        clip.qpos[:, 7 + G1.joint_names.index(f"{side}_shoulder_roll")] += 0.1 * sign
    if named:
        write_plat(tmp_path / "bow.npz", right_first(clip))
        assert "left and right arms are exchanged" in str(validate_motion(load_motions(tmp_path)[0]).reasons)
        return
    write_csv(tmp_path / "bow_50fps.csv", right_first(clip))
    (file,) = read_motion_files(tmp_path, quat_order="wxyz")
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-5)
    assert "joints numbered with the right side first" in file.facts
    assert "right side" not in read_motion_files_of(tmp_path / "left_50fps.csv", clip)


def read_motion_files_of(path, clip: MotionClip) -> str:
    write_csv(path, clip)
    return read_motion_files(path, quat_order="wxyz")[0].facts


def test_arms_alone_exchanged_are_refused(tmp_path):
    clip = bowing_clip()
    swapped = right_first(clip).qpos.copy()
    swapped[:, :22] = clip.qpos[:, :22]
    for side, sign in (("left", 1), ("right", -1)):
        swapped[:, 7 + G1.joint_names.index(f"{side}_hip_roll")] += 0.1 * sign
    write_csv(tmp_path / "bow_50fps.csv", MotionClip("bow", swapped, 50.0))
    with pytest.raises(MotionError, match="its arms have left and right exchanged and its legs do not"):
        load_motions(tmp_path, quat_order="wxyz")
    # for a moment anyone may stand so
    write_csv(tmp_path / "bow_50fps.csv", MotionClip("bow", swapped[:10], 50.0))
    np.testing.assert_allclose(load_motions(tmp_path, quat_order="wxyz")[0].qpos, swapped[:10], atol=1e-5)


def test_texts_beside_a_motion(tmp_path):
    """Times that were not understood were left out without a word, and 30 frames a second were assumed."""

    def write(name: str, column: str) -> None:
        rows = [
            ",".join((f"{column} {n}", *(f"{value:.7g}" for value in row))) for n, row in enumerate(bowing_clip().qpos)
        ]
        (tmp_path / name).write_text("\n".join([",".join((column, *NAMES)), *rows]))

    write("a.csv", "time")
    told = (
        r"a.csv': column 1 .'time'. holds 'time 0', expected a number or a time .or state them: "
        r"plat motions convert --fps.$"
    )
    with pytest.raises(MotionError, match=told):
        load_motions(tmp_path / "a.csv")
    assert load_motions(tmp_path / "a.csv", fps=50)[0].fps == 50
    write("a_50fps.csv", "time")
    assert "1 column of texts left out ('time')" in read_back(tmp_path / "a_50fps.csv")[0].facts
    write("b_50fps.csv", "image")
    assert "1 column of texts left out ('image')" in read_back(tmp_path / "b_50fps.csv")[0].facts


@pytest.mark.parametrize("unit", [1, 1000])
def test_uneven_times_are_made_even(tmp_path, unit):
    clip = bowing_clip(41)
    even = np.linspace(0, 0.8, 41)
    times = np.sort(np.concatenate((np.linspace(0, 0.4, 26), np.linspace(0.4, 0.8, 16)[1:])))  # 16 and 27 ms apart
    at = np.clip(np.searchsorted(even, times, side="right") - 1, 0, 39)
    part = ((times - even[at]) / 0.02)[:, None]
    qpos = (1 - part) * clip.qpos[at] + part * clip.qpos[at + 1]
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    write_table(tmp_path / "a.csv", np.hstack((unit * times[:, None], qpos)), ["time", *NAMES])
    file, found = read_back(tmp_path / "a.csv")
    assert found.fps == 50
    assert "frames 0.016 to 0.0267 s apart, resampled to even ones" in file.facts
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=0.01)
    assert np.abs(qpos - clip.qpos).max() > 0.05
    assert read_back(tmp_path / "a.csv", fps=50)[0].clips[0].notes == ()  # as who states it wants


def test_short_quaternions_at_a_place_that_looks_like_one_stay_where_they_are():
    turn = 0.9 * np.array([0.6, 0.0, 0.0, 0.8])
    height = np.sqrt(1 - turn[0] ** 2) + np.linspace(-0.005, 0.005, 20)
    rows = np.column_stack((np.zeros((20, 2)), height, np.tile(turn, (20, 1)), np.zeros((20, 29))))
    assert np.abs(np.linalg.norm(rows[:, :4], axis=1) - 1).max() < 0.01
    assert place_first(rows)[1] == []
    assert place_first(rows[:, [4, 5, 6, 0, 1, 2, 3, *range(7, 36)]])[1] == []


def test_each_column_of_the_root_may_have_its_unit(tmp_path):
    clip = bowing_clip()
    header = [*with_units("cm")[:2], *with_units("mm")[2:]]
    write_table(tmp_path / "a_50fps.csv", clip.qpos * [100, 100, 1000, *[1] * 33], header)
    np.testing.assert_allclose(load_motions(tmp_path / "a_50fps.csv")[0].qpos, clip.qpos, atol=1e-5)


@pytest.mark.parametrize("named", [True, False])
def test_a_state_as_lerobot_names_it(tmp_path, named):
    clip = bowing_clip()
    names = (*NAMES[:7], *G1.joint_names) if named else map(str, range(36))
    header = [
        "episode_index",
        "frame_index",
        "timestamp",
        "task_index",
        *(f"observation.state.{name}" for name in names),
    ]
    frames = np.arange(len(clip.qpos))
    before = np.stack((0 * frames, frames, frames / 50, 0 * frames), 1)
    header += [f"action.{name}" for name in (G1.joint_names if named else range(29))]
    values = np.hstack((before, clip.qpos, clip.qpos[:, 7:] + 0.1))
    write_table(tmp_path / "a.csv", values, header)
    (read,) = load_motions(tmp_path / "a.csv", quat_order="wxyz")
    np.testing.assert_allclose(read.qpos, clip.qpos, atol=1e-6)
    assert read.fps == 50
    values[20:, 0] = 1
    write_table(tmp_path / "a.csv", values, header)
    with pytest.raises(MotionError, match="are these several motions"):
        load_motions(tmp_path / "a.csv", quat_order="wxyz")
