import io
import json
import pickle
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import MotionClip, generate_motions, load_motions, read_motion_files, save_csv, save_motions
from plat.motions.clip import ASSUMED_RATE
from plat.robots import G1
from tests.motions.formats.writers import (
    ISAAC_ORDER,
    WITHOUT_WRISTS,
    body_poses,
    bowing_clip,
    gmr_fields,
    link_arrays,
    turned,
    write_full_tracker,
    write_tracker,
)


def test_joints_and_root_in_their_arrays(tmp_path):
    write_tracker(tmp_path / "bow.npz", bowing_clip(), ISAAC_ORDER)
    (file,) = read_motion_files(tmp_path / "bow.npz")
    np.testing.assert_allclose(file.clips[0].qpos, bowing_clip().qpos, atol=1e-6)
    assert file.clips[0].name == "bow"
    assert file.facts == "tracker npz, 50 fps, quaternion wxyz, joints reordered by name"


def test_joints_and_root_in_one_array(tmp_path):
    write_full_tracker(tmp_path / "bow.npz", bowing_clip())
    np.testing.assert_allclose(load_motions(tmp_path / "bow.npz")[0].qpos, bowing_clip().qpos, atol=1e-6)


@pytest.mark.parametrize(("order", "told"), [(None, "depth first"), (ISAAC_ORDER, "breadth first")])
def test_without_names_the_bodies_tell_the_order(tmp_path, order, told):
    write_tracker(tmp_path / "bow.npz", bowing_clip(), order, named=False)
    (file,) = read_motion_files(tmp_path / "bow.npz")
    np.testing.assert_allclose(file.clips[0].qpos, bowing_clip().qpos, atol=1e-6)
    assert f"the bodies fit joints numbered {told}" in file.facts


def test_an_order_that_nothing_tells_is_refused(tmp_path):
    backwards = list(G1.joint_names)[::-1]
    write_tracker(tmp_path / "a.npz", bowing_clip(), backwards, named=False)
    with pytest.raises(MotionError, match="no usual order of joints fits its 'body_pos_w'; add 'joint_names'"):
        load_motions(tmp_path / "a.npz")
    straight = np.tile(G1.default_qpos, (5, 1))
    straight[:, 7:] = 0
    write_tracker(tmp_path / "a.npz", MotionClip("straight", straight, 50.0), named=False)
    with pytest.raises(MotionError, match="more than one usual order"):
        load_motions(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", fps=50, joint_pos=straight)
    with pytest.raises(MotionError, match="no array 'joint_names' and no usable 'body_pos_w'"):
        load_motions(tmp_path / "a.npz")


def test_the_root_is_found_by_name(tmp_path):
    clip = bowing_clip()
    pos, quat = body_poses(clip)
    arrays = {"fps": 50, "joint_pos": clip.qpos[:, 7:], "joint_names": G1.joint_names}
    world = np.zeros((len(pos), 1, 3)), np.tile([1.0, 0, 0, 0], (len(pos), 1, 1))
    arrays["body_pos_w"], arrays["body_quat_w"] = (
        np.concatenate(parts, 1) for parts in zip(world, (pos, quat), strict=True)
    )
    np.savez(tmp_path / "a.npz", **arrays, body_names=["world", *G1.keypoints])
    np.testing.assert_allclose(load_motions(tmp_path / "a.npz")[0].qpos, clip.qpos, atol=1e-6)
    np.savez(tmp_path / "a.npz", **arrays, body_names=["world", *["limb"] * 14])
    with pytest.raises(MotionError, match="'body_names' lacks 'pelvis'"):
        load_motions(tmp_path / "a.npz")


def test_a_clip_called_qpos_has_the_name_of_its_file(tmp_path):
    np.savez(tmp_path / "walk.npz", qpos=bowing_clip().qpos, fps=30)
    assert load_motions(tmp_path / "walk.npz")[0].name == "walk"


def test_wrists_may_be_missing(tmp_path):
    names = [name for name in G1.joint_names if "wrist" not in name]
    write_tracker(tmp_path / "a.npz", bowing_clip(), names)
    (clip,) = load_motions(tmp_path / "a.npz")
    wrists = [7 + index for index, name in enumerate(G1.joint_names) if "wrist" in name]
    assert (clip.qpos[:, wrists] == 0).all()
    assert (clip.qpos[:, 10:22] == bowing_clip().qpos[:, 10:22]).all()


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (
            {"joint_pos": np.zeros((5, 29)), "place": np.zeros((5, 3))},
            "no array 'body_pos_w' with the root in it, and no 'root_pos' with 'root_quat', .*; it has 'joint_pos', ",
        ),
        ({"joint_pos": np.zeros((5, 29)), "body_pos_w": np.zeros((4, 30, 3))}, "'body_pos_w' has shape .4, 30, 3."),
        ({"joint_pos": np.zeros(5)}, "'joint_pos' has shape"),
        ({"joint_pos": np.zeros((5, 36))}, "no array 'joint_names'"),
        ({"joint_pos": np.zeros((5, 36)), "joint_names": ["knee"] * 29}, "has the unknown .*knee"),
        ({"joint_pos": np.zeros((5, 36)), "joint_names": np.arange(29)}, "'joint_names' is not a list of names"),
        ({"joint_pos": np.zeros((5, 36)), "joint_names": G1.joint_names}, "quaternion of frame 0"),
    ],
)
def test_errors_name_file_and_field(tmp_path, arrays, message):
    np.savez(tmp_path / "bad.npz", fps=50, **arrays)
    with pytest.raises(MotionError, match=rf"bad.npz'.*{message}"):
        load_motions(tmp_path / "bad.npz")


def archive(path, content: bytes, compression: int = zipfile.ZIP_DEFLATED) -> None:
    with zipfile.ZipFile(path, "w", compression) as file:
        file.writestr("a.npy", content)


def array_bytes(value: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, value)
    return file.getvalue()


def test_bombs_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "bomb.npz"
    monkeypatch.setattr("plat.motions.formats.decompress._GENEROUS", 1 << 20)
    archive(path, bytes(3 << 20))
    with pytest.raises(MotionError, match="unpacks to far more than its size"):
        load_motions(path)
    content = array_bytes(np.zeros((2, 36)))
    archive(path, content.replace(b"(2, 36), }      ", b"(2000000, 36), }"))
    with pytest.raises(MotionError, match=r"an array of shape .2000000, 36. does not have the bytes for it"):
        load_motions(path)
    archive(path, content, zipfile.ZIP_LZMA)
    with pytest.raises(MotionError, match="compressed in a way that NumPy does not use"):
        load_motions(path)
    # a directory that says less than there is
    archive(path, content + bytes(1 << 20))
    lying = path.read_bytes().replace(
        (len(content) + (1 << 20)).to_bytes(4, "little"), len(content).to_bytes(4, "little")
    )
    path.write_bytes(lying)
    with pytest.raises(MotionError, match="Bad CRC-32"):
        load_motions(path)


def test_of_two_arrays_of_one_meaning_the_other_is_told(tmp_path):
    """The last one was read, without a word."""
    fields = {name: value for name, value in gmr_fields(bowing_clip()).items() if name != "links"}
    for name, second in (("same", fields["dof_pos"]), ("other", 0 * fields["dof_pos"])):
        np.savez(tmp_path / f"{name}.npz", **fields, dof=second)
        (file,) = read_motion_files(tmp_path / f"{name}.npz")
        np.testing.assert_allclose(file.clips[0].qpos, bowing_clip().qpos, atol=1e-6)
        assert ("array 'dof' left out" in file.facts) == (name == "other")


def test_what_lies_beside_qpos_is_no_clip(tmp_path):
    clip = bowing_clip()
    beside = {"qvel": np.zeros((40, 35)), "human_joints": np.zeros((41, 22, 3)), "cost": 0.5, "source": "a tool"}
    np.savez(tmp_path / "take.npz", qpos=clip.qpos, fps=50, **beside)
    (file,) = read_motion_files(tmp_path / "take.npz")
    assert [found.name for found in file.clips] == ["take"]
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-6)
    assert "4 other arrays left out (qvel, human_joints, cost)" in file.facts


def test_an_object_beside_the_robot_is_left_out(tmp_path):
    clip = bowing_clip()
    np.savez(tmp_path / "take.npz", qpos=np.hstack((clip.qpos, np.full((40, 7), 0.3))), fps=50)
    (file,) = read_motion_files(tmp_path / "take.npz")
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-6)
    assert "the last 7 columns left out (an object)" in file.facts


def test_a_hand_among_the_joints_is_no_object(tmp_path):
    qpos = bowing_clip().qpos
    hand = np.full((len(qpos), 7), 0.1)
    arm = qpos[:, 29:] + np.linspace(0, 0.2, len(qpos))[:, None]
    np.savez(tmp_path / "hand.npz", qpos=np.concatenate((qpos[:, :29], hand, arm), 1), fps=50)
    with pytest.raises(MotionError, match=r"hand.npz'.*has 43 columns and the last 7 are no pose .*expected 36"):
        load_motions(tmp_path / "hand.npz")


@pytest.mark.parametrize("named", [True, False])
def test_a_whole_pose_without_wrists(tmp_path, named):
    clip = bowing_clip()
    columns = [*range(7), *(7 + index for index in WITHOUT_WRISTS)]
    names = {"joint_names": [G1.joint_names[index] for index in WITHOUT_WRISTS]} if named else {}
    np.savez(tmp_path / "a.npz", walk=clip.qpos[:, columns], fps=50, **names)
    (found,) = load_motions(tmp_path / "a.npz")
    np.testing.assert_allclose(found.qpos[:, columns], clip.qpos[:, columns], atol=1e-6)
    assert found.notes == ("no wrists in the file: default pose",)


def test_meta_json_gives_what_the_archive_does_not_say(tmp_path):
    clip = bowing_clip()
    pos, quat = body_poses(clip)
    names = [f"{name}_joint" for name in ISAAC_ORDER]
    joints = clip.qpos[:, [7 + G1.joint_names.index(name) for name in ISAAC_ORDER]]
    np.savez(tmp_path / "motion.npz", joint_pos=joints, body_pos_w=pos, body_quat_w=quat)
    meta = {"fps": 50.0, "joint_names": names, "body_names": list(G1.keypoints)}
    (tmp_path / "meta.json").write_text(json.dumps(meta))
    (file,) = read_motion_files(tmp_path)
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-6)
    assert "50 fps, fps, joint_names, body_names from meta.json" in file.facts
    # 25 joints, as the robot without four of its wrists' joints has
    few = [name for name in ISAAC_ORDER if not name.endswith(("wrist_pitch", "wrist_yaw"))]
    joints = clip.qpos[:, [7 + G1.joint_names.index(name) for name in few]]
    np.savez(tmp_path / "motion.npz", joint_pos=joints, body_pos_w=pos, body_quat_w=quat)
    (tmp_path / "meta.json").write_text(json.dumps({**meta, "joint_names": few}))
    (file,) = read_motion_files(tmp_path)
    assert "default pose for the missing left_wrist_pitch, left_wrist_yaw, right_wrist_pitch" in file.facts
    (tmp_path / "meta.json").unlink()
    with pytest.raises(
        MotionError, match="no array 'fps', expected the frames a second .or state them: plat motions convert --fps"
    ):
        load_motions(tmp_path)
    with pytest.raises(MotionError, match="no array 'joint_names', and 25 joints are no robot's whole number"):
        load_motions(tmp_path, fps=50)


def test_a_rate_against_meta_json_is_refused(tmp_path):
    write_tracker(tmp_path / "motion.npz", bowing_clip())
    (tmp_path / "meta.json").write_text('{"fps": 30}')
    with pytest.raises(MotionError, match="it states 50 frames a second and the 'meta.json' beside it 30"):
        load_motions(tmp_path)
    assert load_motions(tmp_path, fps=30)[0].fps == 30


def amp_arrays(clip: MotionClip, order: str) -> dict[str, object]:
    """Arrays as Isaac Lab's AMP has them."""
    pos, quat = body_poses(clip)
    return {
        "fps": 50,
        "dof_names": [f"{name}_joint" for name in G1.joint_names],
        "body_names": list(G1.keypoints),
        "dof_positions": clip.qpos[:, 7:],
        "dof_velocities": np.zeros((40, 29)),
        "body_positions": pos,
        "body_rotations": quat if order == "wxyz" else quat[..., [1, 2, 3, 0]],
    }


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_the_bodies_tell_the_order_of_quaternions(tmp_path, order):
    clip = bowing_clip(heading=0.7)
    np.savez(tmp_path / "amp.npz", **amp_arrays(clip, order))
    (file,) = read_motion_files(tmp_path / "amp.npz")
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-5)
    assert ("the bodies fit quaternion xyzw" in file.facts) == (order == "xyzw")


def test_names_that_the_bodies_contradict_give_way(tmp_path):
    clip = bowing_clip()
    arrays = amp_arrays(clip, "wxyz")
    arrays["dof_names"] = ISAAC_ORDER
    np.savez(tmp_path / "amp.npz", **arrays)
    (file,) = read_motion_files(tmp_path / "amp.npz")
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-5)
    assert "joints numbered depth first" in file.facts


def test_soma_on_the_robot(tmp_path):
    clip = bowing_clip(heading=0.7)
    root = {"robot_root_pos": clip.qpos[:, :3], "robot_root_quat": clip.qpos[:, [4, 5, 6, 3]], "scalar_first": False}
    joints = {"robot_joint_names": G1.joint_names, "robot_joint_pos": clip.qpos[:, 7:]}
    np.savez(tmp_path / "soma.npz", fps=50, human_joint_names=["hips"], **root, **joints)
    np.testing.assert_allclose(load_motions(tmp_path / "soma.npz")[0].qpos, clip.qpos, atol=1e-6)


def test_names_may_be_objects(tmp_path):
    write_tracker(tmp_path / "a.npz", bowing_clip())
    with np.load(tmp_path / "a.npz") as archive:
        arrays = dict(archive)
    arrays["joint_names"] = arrays["joint_names"].astype(object)
    np.savez(tmp_path / "a.npz", **arrays)
    np.testing.assert_allclose(load_motions(tmp_path / "a.npz")[0].qpos, bowing_clip().qpos, atol=1e-6)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"poses": np.zeros((5, 165)), "trans": np.zeros((5, 3)), "mocap_frame_rate": 120}, "human motion of the SMPL"),
        ({"betas": np.zeros(16), "gender": "neutral"}, "a human body's shape of the SMPL family .AMASS., no motion"),
        ({"labels": np.zeros((5, 3)), "fps": 30, "more": np.zeros(4)}, "no clips, .* it has 'labels' .5, 3., 'more'"),
        (
            {"qpos": np.tile(G1.default_qpos, (5, 1)), "fps": 30, "frequency": 60},
            "it states 30 .'fps'. and 60 .'frequency'. frames a second; state which",
        ),
    ],
)
def test_archives_of_other_things_are_named(tmp_path, arrays, message):
    np.savez(tmp_path / "other.npz", **arrays)
    with pytest.raises(MotionError, match=message):
        load_motions(tmp_path / "other.npz")


def test_a_step_gives_the_rate(tmp_path):
    np.savez(tmp_path / "a.npz", qpos=bowing_clip().qpos, dt=0.02)
    assert load_motions(tmp_path / "a.npz")[0].fps == pytest.approx(50)


def test_of_several_rates_the_gait_decides(tmp_path):
    walk = next(clip for clip in generate_motions("train", seconds=20) if clip.name.startswith("walk_"))
    for other in ({"dt": 0.25 / walk.fps}, {"time": np.arange(len(walk.qpos)) * 4 / walk.fps}):
        np.savez(tmp_path / "walk.npz", qpos=walk.qpos, fps=walk.fps, **other)
        (file,) = read_motion_files(tmp_path / "walk.npz")
        assert file.clips[0].fps == walk.fps
        assert f"fps {walk.fps:g} of {walk.fps:g} ('fps') and " in file.facts
        assert "the one that fits its steps" in file.facts
        assert load_motions(tmp_path / "walk.npz", fps=20)[0].fps == 20
        (tmp_path / "walk.pkl").write_bytes(pickle.dumps({"qpos": walk.qpos, "fps": walk.fps, **other}))
        (file,) = read_motion_files(tmp_path / "walk.pkl")
        assert file.clips[0].fps == walk.fps
        assert "the one that fits its steps" in file.facts


def test_clips_are_qpos_and_those_that_are_numbered(tmp_path):
    clip = bowing_clip()
    arrays = {"qpos": clip.qpos, "qpos_1": clip.qpos, "qpos_raw": clip.qpos, "qvel": np.zeros((40, 35))}
    np.savez(tmp_path / "take.npz", **arrays, fps=50, joint_names=G1.joint_names)
    (file,) = read_motion_files(tmp_path / "take.npz")
    assert [found.name for found in file.clips] == ["take", "take_1"]
    assert "2 other arrays left out (qpos_raw, qvel)" in file.facts


def test_joints_that_nothing_names_are_looked_at(tmp_path):
    clip = bowing_clip()
    qpos = clip.qpos[:, [*range(7), *(7 + G1.joint_names.index(name) for name in ISAAC_ORDER)]]
    np.savez(tmp_path / "a.npz", **{f"bow{number}": qpos for number in range(30)}, fps=50)
    (file,) = read_motion_files(tmp_path / "a.npz")
    assert len(file.clips) == 30
    for found in (file.clips[0], file.clips[17]):
        np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-5)
        assert "joints numbered breadth first" in found.notes[0]


def test_kimodo_and_ardy_on_the_robot(tmp_path):
    clip = bowing_clip(heading=0.7)
    arrays = link_arrays(clip)
    places = {name: arrays[name] for name in ("global_rot_mats", "posed_joints")}
    np.savez(tmp_path / "kimodo.npz", **places, foot_contacts=np.zeros((40, 4), dtype=bool))
    np.savez(tmp_path / "ardy.npz", **arrays, fps=25.0, text="a bow")
    ardy, kimodo = read_motion_files(tmp_path)
    for file, rate in ((kimodo, 30), (ardy, 25)):
        np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-5)
        assert (file.format, file.clips[0].fps) == ("Kimodo npz", rate)
    assert "fps as Kimodo writes it" in kimodo.facts
    assert "fps as" not in ardy.facts


def test_links_that_are_not_this_robots_are_refused(tmp_path):
    arrays = link_arrays(bowing_clip())
    arrays["global_rot_mats"] = arrays["global_rot_mats"][:, ::-1]
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(MotionError, match=r"put the joints \d+ cm from 'posed_joints': is it of robot 'g1'"):
        load_motions(tmp_path / "a.npz")
    arrays["global_rot_mats"] = np.ones((40, 34, 3, 3))
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(MotionError, match="matrices that are no rotations"):
        load_motions(tmp_path / "a.npz")


def loco_arrays(*clips: MotionClip) -> dict[str, object]:
    """Arrays as loco-mujoco has them: motions one behind the other, the root among the joints, None for what lacks."""
    ends = np.cumsum([0, *(len(clip.qpos) for clip in clips)])
    return {
        "qpos": np.concatenate([clip.qpos for clip in clips]),
        "qvel": np.zeros((ends[-1], 35)),
        "split_points": ends,
        "joint_names": ["root", *(f"{name}_joint" for name in G1.joint_names)],
        "body_names": ["world", "pelvis"],
        "frequency": 50.0,
        "njnt": 30,
        "metadata": None,
        "site_names": None,
        "xpos": np.zeros(0),
    }


def test_loco_mujoco(tmp_path):
    clip = bowing_clip()
    np.savez(tmp_path / "two.npz", **loco_arrays(clip, turned(clip, 1.0)))
    np.savez(tmp_path / "one.npz", **{**loco_arrays(clip), "metadata": {"source": "us"}})
    one, two = read_motion_files(tmp_path)
    assert [found.name for found in (*one.clips, *two.clips)] == ["one", "two_0", "two_1"]
    assert one.facts == "plat npz, 50 fps"
    np.testing.assert_allclose(two.clips[1].qpos, turned(clip, 1.0).qpos, atol=1e-5)
    np.savez(tmp_path / "one.npz", **{**loco_arrays(clip), "split_points": [0, 30]})
    with pytest.raises(
        MotionError, match=r"'split_points' is \[0, 30\], expected rising numbers from 0 to the 40 frames"
    ):
        load_motions(tmp_path / "one.npz")


def test_joints_of_other_things_are_left_out(tmp_path):
    # a door's joint, as HDMI has it, and the root's name with a column and without one
    clip = bowing_clip()
    names = [f"{name}_joint" for name in G1.joint_names]
    joints = np.column_stack((np.zeros(40), clip.qpos[:, 7:], np.ones(40)))
    pos, quat = body_poses(clip)
    bodies = {"body_pos_w": pos, "body_quat_w": quat, "body_names": G1.keypoints, "fps": 50}
    np.savez(tmp_path / "door.npz", joint_pos=joints, joint_names=["root", *names, "door_joint"], **bodies)
    np.savez(tmp_path / "root.npz", joint_pos=clip.qpos[:, 7:], joint_names=["root", *names], **bodies)
    door, root = read_motion_files(tmp_path)
    for file in (door, root):
        np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-5)
    assert "joints left out: door_joint, root" in door.facts
    assert "left out" not in root.facts


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (
            [f"joint_{number}_x" for number in range(29)],
            "has the unknown .* and 21 more, as another body; expected the 29",
        ),
        (
            [name.replace("elbow", "elbow_pitch").replace("wrist_roll", "elbow_roll") for name in G1.joint_names],
            "of the first G1, whose elbows count from another angle",
        ),
    ],
)
def test_joints_of_other_bodies_are_refused(tmp_path, names, message):
    np.savez(tmp_path / "a.npz", qpos=bowing_clip().qpos, joint_names=names, fps=50)
    with pytest.raises(MotionError, match=message):
        load_motions(tmp_path)


@pytest.mark.parametrize("form", ["npz", "csv"])
def test_a_robot_with_elbows_that_roll_reads_what_it_has_written(tmp_path, form):
    """They were taken for those of the first G1."""
    text = G1.asset_path.read_text().replace("_elbow_joint", "_elbow_roll_joint")
    (tmp_path / "robot.xml").write_text(text)
    pose = {name.replace("elbow", "elbow_roll"): angle for name, angle in G1.default_pose.items()}
    robot = replace(G1, name="rolling", asset=str(tmp_path / "robot.xml"), default_pose=pose)
    clip = bowing_clip()
    if form == "npz":
        save_motions(tmp_path / "a.npz", [clip], robot)
    else:
        save_csv(tmp_path, clip, robot)
    (read,) = load_motions(f"{tmp_path}/*.{form}", robot)
    np.testing.assert_allclose(read.qpos, clip.qpos, atol=1e-5)


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_some_bodies_by_name_are_enough(tmp_path, order):
    # eleven bodies, as AMP files for the G1 have them
    clip = bowing_clip(heading=0.7)
    arrays = amp_arrays(clip, order)
    some = [0, 1, 2, 3, 4, 6]
    for name in ("body_positions", "body_rotations"):
        arrays[name] = arrays[name][:, some]
    arrays["body_names"] = [G1.keypoints[index] for index in some]
    np.savez(tmp_path / "amp.npz", **arrays)
    np.testing.assert_allclose(load_motions(tmp_path / "amp.npz")[0].qpos, clip.qpos, atol=1e-5)


def test_an_hour_of_nothing_in_a_few_kilobytes(tmp_path):
    qpos = np.zeros((300_000, 36), np.int8)
    qpos[:, 3] = 1
    np.savez_compressed(tmp_path / "long.npz", qpos=qpos, fps=120)
    with pytest.raises(MotionError, match="long.npz': it unpacks to 11 million numbers, expected motions"):
        load_motions(tmp_path / "long.npz")


@pytest.mark.parametrize(
    ("kind", "shape"), [("<f8", (10**9, 0)), ("<U0", (10**9,)), ("|S0", (3, 10**9)), ("<f8", (-1,))]
)
def test_rows_without_content(tmp_path, kind, shape):
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": kind, "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("joint_names.npy", member.getvalue())
    with pytest.raises(MotionError, match=r"'joint_names': an array of shape \(.*\) does not have the bytes for it"):
        load_motions(tmp_path / "a.npz")


def test_a_table_of_something_else_beside_a_motion(tmp_path):
    table = np.zeros(3, dtype=[("contact", "f4"), ("foot", "i4")])
    clip = bowing_clip()
    np.savez(tmp_path / "a.npz", qpos=clip.qpos, fps=50, contacts=table, day=np.array(["2026-01-01"], "M8[D]"))
    assert len(load_motions(tmp_path / "a.npz")[0].qpos) == len(clip.qpos)


@pytest.mark.parametrize(
    ("meta", "message"),
    [
        ('{"fps": "fast"}', "'fps' is 'fast', expected a number"),
        ('{"fps": true}', "'fps' is True, expected a number"),
        ('{"fps": 1%s}' % ("0" * 400), "'fps' is 10*.*0, expected one number"),
        ('{"fps": 50, "joint_names": [["a"]]}', r"'joint_names' is \[\['a'\]\], expected a list of names"),
        ('{"fps": 50, "fps": 60}', "field 'fps' comes twice in one object"),
        ("[" * 50_000, r"not a readable JSON file \(nested too deeply\)"),
    ],
)
def test_a_broken_meta_json(tmp_path, meta, message):
    np.savez(tmp_path / "a.npz", qpos=bowing_clip().qpos)
    (tmp_path / "meta.json").write_text(meta)
    with pytest.raises(MotionError, match=f"a.npz': .*{message}"):
        load_motions(tmp_path / "a.npz")


@pytest.mark.parametrize("meta", ["{broken", '{"fps": "as recorded"}', '{"fps": null}', "[1]"])
def test_an_archive_that_states_its_rate_needs_no_meta_json(tmp_path, meta):
    np.savez(tmp_path / "a.npz", qpos=bowing_clip().qpos, fps=50)
    (tmp_path / "meta.json").write_text(meta)
    (file,) = read_motion_files(tmp_path / "a.npz")
    assert file.clips[0].fps == 50
    assert ("the 'meta.json' beside it left out: it cannot be read" in file.facts) == (meta == "{broken")


def test_old_arrays_of_loco_mujoco_are_named(tmp_path):
    np.savez(tmp_path / "walk.npz", q_pelvis_tx=np.zeros(5), q_pelvis_tilt=np.zeros(5), q_torso_joint=np.zeros(5))
    with pytest.raises(MotionError, match="an old data set of loco-mujoco"):
        load_motions(tmp_path / "walk.npz")


def test_a_world_body_before_the_root_is_no_root(tmp_path):
    pos, quat = body_poses(bowing_clip(heading=0.7))
    world = np.concatenate((0 * pos[:, :1], pos), 1), np.concatenate((np.tile([1.0, 0, 0, 0], (40, 1, 1)), quat), 1)
    joints = bowing_clip().qpos[:, 7:]
    np.savez(tmp_path / "bow.npz", fps=50, joint_pos=joints, body_pos_w=world[0], body_quat_w=world[1])
    np.testing.assert_allclose(load_motions(tmp_path / "bow.npz")[0].qpos, bowing_clip(heading=0.7).qpos, atol=1e-5)


def test_clips_without_frames_are_left_out(tmp_path):
    qpos = bowing_clip().qpos
    np.savez(tmp_path / "some.npz", fps=50, a=qpos, b=qpos[:0], c=qpos[:1])
    (file,) = read_motion_files(tmp_path / "some.npz")
    assert [clip.name for clip in file.clips] == ["a"]
    assert "left out, with less than 2 frames: b, c" in file.facts
    np.savez(tmp_path / "none.npz", fps=50, b=qpos[:0], c=qpos[:1])
    with pytest.raises(MotionError, match="motion 'b': 0 frames, expected at least 2"):
        load_motions(tmp_path / "none.npz")


@pytest.mark.parametrize("prefix", ["ref_", ""])
def test_holomotion(tmp_path, prefix):
    """Quaternions of bodies are ``xyzw``, and the rate stands in a text."""
    pos, quat = body_poses(bowing_clip())
    arrays = {"dof_pos": bowing_clip().qpos[:, 7:], "global_translation": pos}
    arrays["global_rotation_quat"] = quat[..., [1, 2, 3, 0]]
    metadata = json.dumps({"motion_key": "bow", "motion_fps": 25.0})
    np.savez(tmp_path / "bow.npz", metadata=metadata, **{prefix + name: array for name, array in arrays.items()})
    (file,) = read_motion_files(tmp_path / "bow.npz")
    np.testing.assert_allclose(file.clips[0].qpos, bowing_clip().qpos, atol=1e-6)
    assert file.clips[0].fps == 25
    assert "fps from 'motion_fps' of its metadata" in file.facts
    np.savez(tmp_path / "bow.npz", metadata=metadata, fps=50, **arrays)
    with pytest.raises(MotionError, match="it states 50 .'fps'. and 25 .'motion_fps'. frames a second; state which"):
        load_motions(tmp_path / "bow.npz")
    np.savez(tmp_path / "bow.npz", metadata="{", **arrays)
    with pytest.raises(MotionError, match="no array 'fps'"):
        load_motions(tmp_path / "bow.npz")


@pytest.fixture(scope="module")
def gait() -> MotionClip:
    return next(clip for clip in generate_motions("train", seconds=20) if clip.name.startswith("walk_"))


def test_the_rate_in_a_name_is_compared_and_the_motion_decides(tmp_path, gait):
    rate = gait.fps
    for name, fps in ((4 * rate, rate), (rate, 4 * rate)):
        path = tmp_path / f"walk_{name:g}fps.npz"
        np.savez(path, qpos=gait.qpos, fps=fps)
        (file,) = read_motion_files(path)
        assert file.clips[0].fps == rate
        told = f"fps {rate:g} of {fps:g} ('fps') and {name:g} (the file name): the one that fits its steps"
        assert told in file.facts


@pytest.mark.parametrize("own", [True, False])
def test_a_file_beats_its_name_where_the_motion_says_nothing(tmp_path, own):
    def write(name: str) -> None:
        if own:
            save_motions(tmp_path / name, [bowing_clip()])
        else:
            np.savez(tmp_path / name, qpos=bowing_clip().qpos, fps=50)

    for name, told in (("a_60fps.npz", True), ("a_50fps.npz", False), ("a_0fps.npz", False)):
        write(name)
        (file,) = read_motion_files(tmp_path / name)
        assert file.clips[0].fps == 50
        assert ("fps 50 ('fps'), though the file name says 60" in file.facts) == told


def test_a_name_beats_what_is_assumed(tmp_path):
    np.savez(tmp_path / "a_60fps.npz", qpos=bowing_clip().qpos)
    save_motions(tmp_path / "b_60fps.npz", [replace(bowing_clip(), notes=(ASSUMED_RATE,))])
    np.savez(tmp_path / "c_60fps.npz", **link_arrays(bowing_clip()))
    for name in "abc":
        (file,) = read_motion_files(tmp_path / f"{name}_60fps.npz")
        assert file.clips[0].fps == 60
        assert "fps from the file name" in file.facts
        assert ASSUMED_RATE not in file.facts


@pytest.mark.parametrize("field", ["qpos", "dof_pos", "walk"])
def test_complex_numbers_are_named(tmp_path, field):
    np.savez(tmp_path / "a.npz", fps=50, **{field: np.zeros((4, 36), complex)})
    with pytest.raises(MotionError, match=f"array '{field}': it holds complex numbers, expected real ones"):
        load_motions(tmp_path / "a.npz")


def test_uneven_times_of_an_archive_are_made_even(tmp_path):
    times = np.concatenate((np.arange(20) * 0.02, 0.38 + np.arange(1, 21) * 0.035))
    np.savez(tmp_path / "a.npz", qpos=bowing_clip().qpos, time=times)
    (file,) = read_motion_files(tmp_path / "a.npz")
    assert "frames 0.02 to 0.035 s apart, resampled to even ones" in file.facts
    (found,) = file.clips
    np.testing.assert_allclose(found.qpos[-1], bowing_clip().qpos[-1], atol=1e-6)
    assert found.duration == pytest.approx(times[-1])
    assert load_motions(tmp_path / "a.npz", fps=50)[0].notes == ()


def test_who_lies_in_a_unit_that_is_not_to_be_told_is_refused(tmp_path):
    qpos = np.tile(G1.default_qpos, (30, 1))
    qpos[:, :7] = [0, 0, 30, np.sqrt(0.5), 0, -np.sqrt(0.5), 0]
    np.savez(tmp_path / "a.npz", clip=qpos, fps=50)
    with pytest.raises(
        MotionError, match="a.npz': the unit of places cannot be determined: .* state it: plat motions convert --units"
    ):
        load_motions(tmp_path / "a.npz")
    (found,) = load_motions(tmp_path / "a.npz", units="cm")
    np.testing.assert_allclose(found.qpos[:, 2], 0.3)


@pytest.mark.parametrize(("mark", "told"), [(2, "is 2, this plat reads up to 1: update plat"), (0, "is 0, expected 1")])
def test_an_archive_of_a_newer_plat_is_refused(tmp_path, mark, told):
    save_motions(tmp_path / "own.npz", [bowing_clip()])
    with np.load(tmp_path / "own.npz") as archive:
        arrays = dict(archive)
    np.savez(tmp_path / "own.npz", **{**arrays, "plat_motions": np.int64(mark)})
    with pytest.raises(MotionError, match=rf"own.npz'.*version \('plat_motions'\) {told}"):
        load_motions(tmp_path / "own.npz")


@pytest.mark.parametrize("marked", [True, False])
def test_a_broken_motion_of_several_is_left_out(tmp_path, marked):
    clips = [replace(bowing_clip(), name=name) for name in "abc"]
    save_motions(tmp_path / "a.npz", clips)
    arrays = dict(np.load(tmp_path / "a.npz"))
    if not marked:
        del arrays["plat_motions"]
    arrays["a"][2, 9] = np.inf
    np.savez(tmp_path / "a.npz", **arrays)
    (file,) = read_motion_files(tmp_path / "a.npz")
    assert [clip.name for clip in file.clips] == ["b", "c"]
    assert list(map(str, file.broken)) == ["motion 'a': qpos[2, 9] is inf, expected a finite number"]


@pytest.mark.parametrize("agree", [True, False])
def test_a_qpos_that_contradicts_the_joints_is_told(tmp_path, agree):
    clip = bowing_clip()
    qpos = clip.qpos if agree else clip.qpos + 0.1
    parts = {"root_pos": clip.qpos[:, :3], "root_quat": clip.qpos[:, 3:7], "joint_pos": clip.qpos[:, 7:]}
    np.savez(tmp_path / "a.npz", qpos=qpos, fps=50, joint_names=G1.joint_names, **parts)
    (file,) = read_motion_files(tmp_path / "a.npz")
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, atol=1e-6)
    assert ("'qpos' left out, which has another motion than 'joint_pos'" in file.notes) != agree
