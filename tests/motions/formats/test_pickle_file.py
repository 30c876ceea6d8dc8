import bz2
import gzip
import lzma
import pickle
import zlib
from dataclasses import replace

import numpy as np
import pytest
import torch

from plat.errors import MotionError
from plat.motions import load_motions, read_motion_files
from plat.motions.formats.joint_orders import usual_orders
from plat.motions.formats.unnamed_joints import OPTIONAL, unnamed_joints
from plat.robots import G1
from plat.rotations import quat_to_rotvec
from tests.motions.formats.test_layouts import clip_with_arms
from tests.motions.formats.writers import asap_motions, bowing_clip, gmr_fields, write_asap, write_gmr


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_gmr(tmp_path, protocol):
    write_gmr(tmp_path / "bow.pkl", bowing_clip(), protocol)
    (file,) = read_motion_files(tmp_path / "bow.pkl")
    np.testing.assert_allclose(file.clips[0].qpos, bowing_clip().qpos, atol=1e-6)
    assert (file.clips[0].name, file.facts) == ("bow", "GMR pickle, 50 fps, quaternion xyzw")


@pytest.mark.filterwarnings("error")
def test_no_frames_are_one_line(tmp_path):
    write_gmr(tmp_path / "none.pkl", replace(bowing_clip(), qpos=bowing_clip().qpos[:0]))
    with pytest.raises(MotionError, match="motion 'none': 0 frames, expected at least 2$"):
        load_motions(tmp_path / "none.pkl")


@pytest.mark.parametrize(
    ("shape", "names"),
    [
        (lambda fields: {"motions": {"walk": fields, "bow": fields}}, ["walk", "bow"]),
        (lambda fields: {"s1": {"bow": fields}, "s2": {"bow": fields}}, ["s1_bow", "s2_bow"]),
        (lambda fields: {"walk": {"motion": fields}}, ["walk"]),
        (lambda fields: {"data": {"motion": fields}}, ["bow"]),
        (lambda fields: {"a": {"b_c": fields}, "a_b": {"c": fields}}, ["a_b_c", "a_b_c_2"]),
        (lambda fields: {"meta": {"fps": 50, "by": "me"}, "motions": {"walk": without_rate(fields)}}, ["walk"]),
        (lambda fields: {"info": {"fps": 50, "tags": ["a"]}, "motions": {"walk": without_rate(fields)}}, ["walk"]),
        (lambda fields: {"motion": without_rate(fields), "meta": {"fps": [50], "robot": "g1"}}, ["motion"]),
    ],
)
def test_motions_in_groups(tmp_path, shape, names):
    content = shape(gmr_fields(bowing_clip()))
    (tmp_path / "bow.pkl").write_bytes(pickle.dumps(content))
    clips = load_motions(tmp_path / "bow.pkl")
    assert [clip.name for clip in clips] == names
    for clip in clips:
        assert clip.fps == 50
        np.testing.assert_allclose(clip.qpos, bowing_clip().qpos, atol=1e-6)


def without_rate(fields: dict[str, object]) -> dict[str, object]:
    return {name: value for name, value in fields.items() if name != "fps"}


def test_groups_of_groups_are_refused_and_do_not_multiply(tmp_path):
    inner = {f"m{number}": {} for number in range(2000)}
    for content, message in (
        ({f"g{number}": inner for number in range(2000)}, "names more than 1000000 motions"),
        ({"a": {"b": {"c": gmr_fields(bowing_clip())}}}, r"motion 'a_b': no field 'root_pos'.*only \['c'\]"),
    ):
        (tmp_path / "bow.pkl").write_bytes(pickle.dumps(content))
        with pytest.raises(MotionError, match=message):
            load_motions(tmp_path / "bow.pkl")


@pytest.mark.parametrize("row", [tuple, list, np.array])
def test_rows_of_any_kind(tmp_path, row):
    fields = {
        name: [row(values) for values in value.tolist()] if isinstance(value, np.ndarray) and value.ndim == 2 else value
        for name, value in gmr_fields(bowing_clip()).items()
    }
    assert isinstance(fields["dof_pos"], list)
    (tmp_path / "bow.pkl").write_bytes(pickle.dumps(fields))
    np.testing.assert_allclose(load_motions(tmp_path / "bow.pkl")[0].qpos, bowing_clip().qpos, atol=1e-6)


def keep(data: bytes) -> bytes:
    return data


@pytest.mark.parametrize("compress", [keep, zlib.compress, bz2.compress, lzma.compress])
@pytest.mark.parametrize("aligned", [True, False])
def test_asap(tmp_path, compress, aligned):
    write_asap(tmp_path / "two.pkl", bowing_clip(), compress, aligned)
    (file,) = read_motion_files(tmp_path / "two.pkl")
    assert [clip.name for clip in file.clips] == ["first", "second"]
    assert "no wrists in the file" in file.facts
    wrists = np.array(["wrist" in name for name in G1.joint_names])
    for clip in file.clips:
        np.testing.assert_allclose(clip.qpos[:, :7], bowing_clip().qpos[:, :7], atol=1e-6)
        np.testing.assert_allclose(clip.qpos[:, 7:][:, ~wrists], bowing_clip().qpos[:, 7:][:, ~wrists], atol=1e-6)
        assert (clip.qpos[:, 7:][:, wrists] == 0).all()


def test_mimickit(tmp_path):
    """Rows of root position, rotation vector and joints, in lists."""
    clip = bowing_clip(heading=0.7)
    turns = quat_to_rotvec(torch.from_numpy(clip.qpos[:, 3:7])).numpy()
    rows = np.concatenate((clip.qpos[:, :3], turns, clip.qpos[:, 7:]), 1).tolist()
    (tmp_path / "bow.pkl").write_bytes(pickle.dumps({"loop_mode": 0, "fps": 50, "frames": rows}))
    (file,) = read_motion_files(tmp_path / "bow.pkl")
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-5)
    assert file.facts == "MimicKit pickle, 50 fps, quaternion wxyz"
    with pytest.raises(MotionError, match="bow.pkl': quat_order is stated, and says nothing about a MimicKit pickle"):
        load_motions(tmp_path / "bow.pkl", quat_order="xyzw")  # it was read as such, and the robot lay
    (tmp_path / "bow.pkl").write_bytes(pickle.dumps({"fps": 50, "frames": np.zeros(40)}))
    with pytest.raises(MotionError, match=r"'frames' has shape \(40,\), expected rows of root position"):
        load_motions(tmp_path / "bow.pkl")


def test_a_stated_order_wins(tmp_path):
    write_gmr(tmp_path / "bow.pkl", bowing_clip())
    stated = load_motions(tmp_path / "bow.pkl", quat_order="wxyz")[0].qpos
    np.testing.assert_allclose(stated[:, [6, 3, 4, 5]], bowing_clip().qpos[:, 3:7], atol=1e-6)


def test_an_order_that_looks_wrong_is_told(tmp_path):
    fields = gmr_fields(bowing_clip())
    fields["root_rot"] = fields["root_rot"][:, [3, 0, 1, 2]]
    (tmp_path / "bow.pkl").write_bytes(pickle.dumps(fields))
    (file,) = read_motion_files(tmp_path / "bow.pkl")
    assert "quaternion wxyz: xyzw, as it should be, makes no plausible motion" in file.facts


def test_joints_are_matched_by_name(tmp_path):
    fields = gmr_fields(bowing_clip())
    fields["dof_pos"] = fields["dof_pos"][:, ::-1]
    fields["joint_names"] = list(G1.joint_names)[::-1]
    (tmp_path / "bow.pkl").write_bytes(pickle.dumps(fields))
    np.testing.assert_allclose(load_motions(tmp_path / "bow.pkl")[0].qpos, bowing_clip().qpos, atol=1e-6)


LAUGHS: list[object] = []
for _ in range(20):  # 10^20 entries for whoever walks through them
    LAUGHS = [LAUGHS] * 10


def in_doubt(clip, order):
    """Return fields whose joints are as likely in the robot's order as in another one."""
    fields = gmr_fields(clip)
    angles = fields["dof_pos"]
    fields["dof_pos"] = 0.2 * angles + 0.8 * angles[:, [G1.joint_names.index(name) for name in order]]
    return fields


def test_a_motion_in_doubt_has_the_joints_of_the_others(tmp_path):
    """Two of 556 hard clips were suspected of another order, and with them a file of all was refused."""
    path, clip = tmp_path / "many.pkl", clip_with_arms(0.7)
    orders = usual_orders(G1)
    doubtful = in_doubt(clip, orders["with the waist last"])
    path.write_bytes(pickle.dumps({"sure": gmr_fields(clip), "doubtful": doubtful, "too": gmr_fields(clip)}))
    clips = load_motions(path)
    assert [found.name for found in clips] == ["sure", "doubtful", "too"]
    np.testing.assert_allclose(clips[1].qpos[:, 7:], doubtful["dof_pos"], atol=1e-6)
    assert [found.notes for found in clips] == [(), ("joints as in the file's other motions",), ()]

    breadth = gmr_fields(clip)
    breadth["dof_pos"] = breadth["dof_pos"][:, [G1.joint_names.index(name) for name in orders["breadth first"]]]
    path.write_bytes(pickle.dumps({"sure": breadth, "doubtful": doubtful}))
    first, second = load_motions(path)
    np.testing.assert_allclose(first.qpos, clip.qpos, atol=1e-6)
    listed = [orders["breadth first"].index(name) for name in G1.joint_names]
    np.testing.assert_allclose(second.qpos[:, 7:], doubtful["dof_pos"][:, listed], atol=1e-6)

    for others in ({}, {"sure": breadth, "other": gmr_fields(clip)}):
        path.write_bytes(pickle.dumps({"doubtful": doubtful, **others}))
        with pytest.raises(MotionError, match=r"many.pkl': motion 'doubtful': nothing states the order of its joints"):
            load_motions(path)


def test_23_joints_in_doubt_are_those_of_the_others(tmp_path):
    small = [name for name in G1.joint_names if "wrist" not in name or name.endswith("wrist_roll")]
    small = [name for name in small if name not in OPTIONAL]
    cut = [name for name in G1.joint_names if "wrist" not in name]
    clip = clip_with_arms(0.7)

    def motion(shares):
        fields = gmr_fields(clip)
        columns = [fields["dof_pos"][:, [G1.joint_names.index(name) for name in names]] for names in (cut, small)]
        return {**fields, "dof_pos": shares * columns[0] + (1 - shares) * columns[1]}

    doubtful = next(motion(share) for share in np.linspace(0, 1, 40) if undecided(motion(share)["dof_pos"]))
    (tmp_path / "many.pkl").write_bytes(pickle.dumps({"doubtful": doubtful, "sure": motion(0)}))
    first, _ = load_motions(tmp_path / "many.pkl")
    index = [G1.joint_names.index(name) for name in small]
    np.testing.assert_allclose(first.qpos[:, 7:][:, index], doubtful["dof_pos"], atol=1e-6)
    (tmp_path / "one.pkl").write_bytes(pickle.dumps(doubtful))
    (alone,) = load_motions(tmp_path / "one.pkl")
    assert "no wrists in the file: default pose" in alone.notes
    assert "which 23 joints it has assumed, as ASAP and PBHC have them: its poses leave it open" in alone.notes
    assert not any("assumed" in note for note in first.notes)


def undecided(angles):
    try:
        unnamed_joints(angles, G1, "dof")
    except MotionError:
        return True
    return False


def without(name: str) -> dict[str, object]:
    return {key: value for key, value in gmr_fields(bowing_clip()).items() if key != name}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (print, "names 'builtins.print', expected arrays"),
        ([1, 2], "holds a list, expected a dictionary"),
        ({}, "holds a dict, expected a dictionary of a motion"),
        ({"a": 1}, "entry 'a' is a int"),
        (without("fps"), "no field 'fps'"),
        (without("root_rot"), "no field 'root_rot' or .*, only"),
        ({"walk": without("dof_pos")}, "motion 'walk': no field 'dof_pos' or 'dof'"),
        ({**without("fps"), "fps": "fast"}, "'fps' is 'fast', expected one number"),
        ({**without("fps"), "fps": LAUGHS}, r"'fps' is \[.*\], expected one number"),
        ({**without(""), "dof_pos": LAUGHS}, "'dof_pos' is a list, expected an array"),
        ({**without(""), "joint_names": LAUGHS}, "'joint_names' is not a list of names"),
        ({"walk": LAUGHS}, "entry 'walk' is a list"),
        ({**without(""), "dof_pos": np.zeros((40, 27))}, "has 27 joints, expected the 29 joints of 'g1', or 23"),
        ({**without(""), "root_pos": np.zeros((39, 3))}, "has shape .39, 3., expected .40, 3."),
        ({**without(""), "root_rot": [0, 0, 0, 1]}, "'root_rot' is a list, expected an array"),
        ({**without(""), "root_rot": np.zeros((40, 4))}, "quaternion of frame 0"),
        ({**without(""), "dof_pos": np.full((40, 29), np.nan)}, "is nan"),
        ({**without(""), "dof_pos": np.full((40, 29), "a")}, "expected .frames, joints."),
    ],
)
def test_errors_name_file_and_field(tmp_path, content, message):
    (tmp_path / "bad.pkl").write_bytes(pickle.dumps(content))
    with pytest.raises(MotionError, match=rf"bad.pkl'.*{message}"):
        load_motions(tmp_path / "bad.pkl")


def test_one_array_cannot_stand_for_any_number_of_motions(tmp_path):
    refusals = ((500, "it names 500 motions, expected at least 256 bytes for each"), (40, "larger than the file"))
    for count, message in refusals:
        motions = asap_motions(bowing_clip(), tuple(f"{index}" for index in range(count)))
        (tmp_path / "many.pkl").write_bytes(pickle.dumps(motions))
        with pytest.raises(MotionError, match=message):
            load_motions(tmp_path / "many.pkl")


def test_an_hour_of_nothing_in_a_few_kilobytes(tmp_path):
    rows = 300_000
    motion = {
        "root_pos": np.zeros((rows, 3), np.int8),
        "root_rot": np.tile(np.int8([0, 0, 0, 1]), (rows, 1)),
        "dof_pos": np.zeros((rows, 29), np.int8),
        "fps": 120,
    }
    (tmp_path / "long.pkl").write_bytes(gzip.compress(pickle.dumps(motion, 4)))
    with pytest.raises(MotionError, match="long.pkl': it unpacks to 11 million numbers, expected motions"):
        load_motions(tmp_path / "long.pkl")


def test_quaternions_of_about_unit_length(tmp_path):
    fields = gmr_fields(bowing_clip())
    fields["root_rot"] = 0.965 * fields["root_rot"]
    (tmp_path / "bow.pkl").write_bytes(pickle.dumps(fields))
    (clip,) = load_motions(tmp_path / "bow.pkl")
    np.testing.assert_allclose(clip.qpos, bowing_clip().qpos, atol=1e-6)
    assert clip.notes == ("root quaternions of length 0.965 to 0.965 made unit",)


def test_a_root_in_millimeters(tmp_path):
    fields = gmr_fields(bowing_clip())
    fields["root_pos"] = 1000 * fields["root_pos"]
    (tmp_path / "bow.pkl").write_bytes(pickle.dumps(fields))
    (clip,) = load_motions(tmp_path / "bow.pkl")
    np.testing.assert_allclose(clip.qpos, bowing_clip().qpos, atol=1e-6)
    assert "root position in millimeters" in clip.notes[0]


def test_a_human_body_is_named(tmp_path):
    (tmp_path / "amass.pkl").write_bytes(pickle.dumps({"pose_aa": np.zeros((5, 72)), "trans": np.zeros((5, 3))}))
    with pytest.raises(MotionError, match="human motion of the SMPL family .AMASS., not of a robot"):
        load_motions(tmp_path / "amass.pkl")


def test_the_rate_in_a_name_is_compared(tmp_path):
    write_gmr(tmp_path / "a_60fps.pkl", bowing_clip())
    (file,) = read_motion_files(tmp_path / "a_60fps.pkl")
    assert file.clips[0].fps == 50
    assert "fps 50 ('fps'), though the file name says 60" in file.facts
    fields = gmr_fields(bowing_clip())
    del fields["fps"]
    (tmp_path / "b_60fps.pkl").write_bytes(pickle.dumps(fields))
    (file,) = read_motion_files(tmp_path / "b_60fps.pkl")
    assert file.clips[0].fps == 60
    assert "fps from the file name" in file.facts


@pytest.mark.parametrize("rate", [50, np.float64(50), np.array([50])])
def test_what_holds_for_all_motions_may_stand_beside_them(tmp_path, rate):
    fields = gmr_fields(bowing_clip())
    del fields["fps"]
    backwards = {**fields, "dof_pos": fields["dof_pos"][:, ::-1]}
    names = [f"{name}_joint" for name in G1.joint_names[::-1]]
    content = {"fps": rate, "version": "1", "joint_names": names, "a": backwards, "b": {**backwards, "fps": 25}}
    (tmp_path / "all.pkl").write_bytes(pickle.dumps(content))
    first, second = load_motions(tmp_path / "all.pkl")
    assert (first.name, first.fps, second.name, second.fps) == ("a", 50, "b", 25)
    np.testing.assert_allclose(first.qpos, bowing_clip().qpos, atol=1e-6)


def test_joints_by_that_name_alone(tmp_path):
    place, quat, joints = np.split(bowing_clip().qpos, (3, 7), axis=1)
    fields = {"joints": joints, "root_pos": place, "root_quat": quat, "fps": 50, "dt": None}
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(fields))
    np.testing.assert_allclose(load_motions(tmp_path / "a.pkl")[0].qpos, bowing_clip().qpos, atol=1e-6)
    (tmp_path / "b.pkl").write_bytes(pickle.dumps({"root_pos": place, "root_rot": quat, "fps": 50}))
    with pytest.raises(MotionError, match="no field 'dof_pos' or 'dof' or 'joint_pos', only"):
        load_motions(tmp_path / "b.pkl")


def test_humans_among_motions_are_named_as_such(tmp_path):
    fields = {"pose_aa": np.zeros((9, 72)), "trans_orig": np.zeros((9, 3)), "beta": np.zeros(16), "fps": 30}
    (tmp_path / "phc.pkl").write_bytes(pickle.dumps({"0-walk": fields}))
    with pytest.raises(MotionError, match="motion '0-walk': human motion of the SMPL family .AMASS., not of a robot"):
        load_motions(tmp_path / "phc.pkl")


def test_objects_behind_the_first_are_refused(tmp_path):
    once = pickle.dumps(gmr_fields(bowing_clip()))
    path = tmp_path / "two.pkl"
    path.write_bytes(once + once)
    with pytest.raises(
        MotionError, match="two.pkl': it goes on behind its first object, expected one: a dictionary of"
    ):
        load_motions(path)
    path.write_bytes(once + b"\n")
    assert len(load_motions(path)) == 1


@pytest.mark.parametrize("whole", [True, False])
def test_rows_of_qpos_may_be_lists(tmp_path, whole):
    rows = bowing_clip().qpos.tolist()
    (tmp_path / "bow.pkl").write_bytes(pickle.dumps({"fps": 50, "qpos": rows} if whole else rows))
    (clip,) = load_motions(tmp_path / "bow.pkl", fps=None if whole else 50)
    np.testing.assert_allclose(clip.qpos, bowing_clip().qpos, atol=1e-6)


def test_a_motion_of_one_frame_is_left_out(tmp_path):
    whole = gmr_fields(bowing_clip())
    short = gmr_fields(replace(bowing_clip(), qpos=bowing_clip().qpos[:1]))
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"walk": whole, "b": short}))
    (file,) = read_motion_files(tmp_path / "a.pkl")
    assert [clip.name for clip in file.clips] == ["walk"]
    assert "left out, with less than 2 frames: b" in file.facts
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"b": short}))
    with pytest.raises(MotionError, match="a.pkl': motion 'b': 1 frame, expected at least 2$"):
        load_motions(tmp_path / "a.pkl")


def test_uneven_times_of_a_pickle_are_made_even(tmp_path):
    fields = {
        **gmr_fields(bowing_clip()),
        "time": np.concatenate((np.arange(20) * 0.02, 0.38 + np.arange(1, 21) * 0.035)),
    }
    del fields["fps"]
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(fields))
    (file,) = read_motion_files(tmp_path / "a.pkl")
    assert "frames 0.02 to 0.035 s apart, resampled to even ones" in file.facts


@pytest.mark.parametrize("joints", [29, 23])
def test_a_broken_motion_of_several_is_left_out(tmp_path, joints):
    fields = {name: gmr_fields(bowing_clip()) for name in ("a", "b", "c")}
    if joints == 23:
        for motion in fields.values():
            motion["dof_pos"] = motion["dof_pos"][:, ["wrist" not in name for name in G1.joint_names]]
    fields["a"]["dof_pos"][3, 4] = np.nan
    del fields["b"]["root_rot"]
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps(fields))
    (file,) = read_motion_files(path)
    assert [clip.name for clip in file.clips] == ["c"]
    assert sorted(str(error).partition(",")[0] for error in file.broken) == [
        "motion 'a': qpos[3",
        "motion 'b': no field 'root_rot' or 'root_quat' or 'base_quat'",
    ]


@pytest.mark.parametrize("agree", [True, False])
def test_joints_that_contradict_qpos_are_told(tmp_path, agree):
    clip = bowing_clip()
    other = clip.qpos[:, 7:] if agree else clip.qpos[::-1, 7:] + 0.1
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"qpos": clip.qpos, "dof_pos": other, "fps": 50}))
    (read,) = load_motions(tmp_path / "a.pkl")
    np.testing.assert_allclose(read.qpos, clip.qpos, atol=1e-6)
    assert ("'dof_pos' left out, which has another motion than 'qpos'" in read.notes) != agree
