from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plat.errors import MotionError
from plat.motions.retargeting import Mocap, SkeletonMap, builtin_maps, read_bvh
from plat.motions.retargeting.human import Human, read_human

from .human import write_human

LAFAN1 = next(skeleton for skeleton in builtin_maps() if skeleton.name == "lafan1")
AUTO = SkeletonMap("auto", LAFAN1.joints)


def human(path, skeleton: SkeletonMap) -> Human:
    return read_human(read_bvh(path), skeleton, "clip.bvh")


def turned(mocap: Mocap, turn: Rotation, shift: tuple[float, float, float] = (0, 0, 0)) -> Mocap:
    """A capture in other axes."""
    places = turn.apply(mocap.positions.reshape(-1, 3)).reshape(mocap.positions.shape) + np.array(shift)
    return replace(mocap, positions=places, rotations=turn.as_matrix() @ mocap.rotations)


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("unit", [0.1, 1.0, 2.54, 5.6444, 100.0], ids=["mm", "cm", "in", "in/0.45", "m"])
def test_units_and_up_axis_are_told_from_the_file(tmp_path, up, unit):
    expected = human(write_human(tmp_path / "a.bvh"), LAFAN1)
    found = human(write_human(tmp_path / "b.bvh", up=up, unit=unit), AUTO)
    assert found.leg == pytest.approx(0.859, abs=1e-3)
    for role, position in expected.positions.items():
        np.testing.assert_allclose(found.positions[role], position, atol=1e-4)
    np.testing.assert_allclose(found.rotations["left_ankle"], expected.rotations["left_ankle"], atol=1e-4)
    head = found.positions["neck"] - found.positions["hips"]
    left = found.positions["left_hip"] - found.positions["right_hip"]
    toes = found.positions["left_toe"] - found.positions["left_ankle"]
    assert head[0, 2] > 0.5
    # seen from above, left is a quarter turn against the clock from forward
    assert np.cross(left[0], toes[0])[2] < 0


@pytest.mark.parametrize("up", ["x", "z"])
def test_a_stated_axis_gives_way_to_the_motion(tmp_path, up):
    expected = human(write_human(tmp_path / "a.bvh"), LAFAN1)
    assert expected.notes == ()
    found = human(write_human(tmp_path / "b.bvh", up=up), LAFAN1)
    np.testing.assert_allclose(found.positions["neck"], expected.positions["neck"], atol=1e-4)
    assert found.notes == (f"{up} up and not y, as stated: the body stands along it",)


@pytest.mark.parametrize("stated", ["auto", "y"])
@pytest.mark.parametrize(("turn", "along"), [(("z", -90), "x"), (("x", 90), "z")], ids=["head along x", "head along z"])
def test_who_lies_is_not_stood_up(tmp_path, stated, turn, along):
    standing = read_bvh(write_human(tmp_path / "a.bvh"))
    turn = Rotation.from_euler(*turn, degrees=True)
    hips = turn.apply(standing.positions[0, 0])
    lying = turned(standing, turn, tuple(np.array([120.0, 12.0, -300.0]) - hips))
    found = read_human(lying, replace(AUTO, up=stated), "clip.bvh")
    assert found.positions["hips"][0, 2] == pytest.approx(0.12, abs=0.01)
    assert abs(found.positions["neck"][0, 2] - found.positions["hips"][0, 2]) < 0.2
    assert found.notes == (f"y up: the body lies along {along}",)


@pytest.mark.parametrize("turn", [("z", 90), ("x", -90)], ids=["head along -x", "head along -z"])
def test_who_lies_the_other_way_round_is_not_stood_up(tmp_path, turn):
    standing = read_bvh(write_human(tmp_path / "a.bvh"))
    turn = Rotation.from_euler(*turn, degrees=True)
    lying = turned(standing, turn, tuple(np.array([120.0, 12.0, -300.0]) - turn.apply(standing.positions[0, 0])))
    found = read_human(lying, replace(AUTO, up="y"), "clip.bvh")
    assert abs(found.positions["neck"][0, 2] - found.positions["hips"][0, 2]) < 0.2
    try:
        guessed = read_human(lying, AUTO, "clip.bvh")
    except MotionError as error:
        assert "which axis is up cannot be determined" in str(error)  # noqa: PT017
    else:
        np.testing.assert_allclose(guessed.positions["neck"], found.positions["neck"])


@pytest.mark.parametrize("heading", [0, 90, 180, 270])
def test_who_sits_with_legs_forward_is_not_laid_down(tmp_path, heading):
    turns = {f"{side}UpLeg": (-85.0, 0.0, 0.0) for side in ("Left", "Right")}
    mocap = read_bvh(write_human(tmp_path / "a.bvh", turns=turns, frames=31))
    held = replace(mocap, positions=mocap.positions[15:16].repeat(9, 0), rotations=mocap.rotations[15:16].repeat(9, 0))
    turn = Rotation.from_euler("y", heading, degrees=True)
    shift = np.array([120.0, 12.0, -300.0]) - turn.apply(held.positions[0, 0])
    for skeleton in (AUTO, LAFAN1):
        found = read_human(turned(held, turn, tuple(shift)), skeleton, "clip.bvh")
        assert found.positions["neck"][0, 2] - found.positions["hips"][0, 2] > 0.5
        assert found.positions["hips"][0, 2] == pytest.approx(0.12, abs=0.01)


def test_an_axis_that_nothing_tells_is_refused(tmp_path):
    standing = read_bvh(write_human(tmp_path / "a.bvh"))
    tilted = turned(standing, Rotation.from_euler("x", 45, degrees=True), (0, 500, 500))
    with pytest.raises(MotionError, match=r"clip.bvh: which axis is up"):
        read_human(tilted, AUTO, "clip.bvh")
    # far from any floor a standing body could as well lie
    far = turned(standing, Rotation.from_euler("x", 90, degrees=True), (0, 900, 900))
    with pytest.raises(MotionError, match="y should be up, and the body stands along z; does it lie"):
        read_human(far, LAFAN1, "clip.bvh")
    upside_down = turned(standing, Rotation.from_euler("x", 180, degrees=True))
    with pytest.raises(MotionError, match="along the stated up axis y the head is below the feet; turn it"):
        read_human(upside_down, LAFAN1, "clip.bvh")
    # joints in a camera's axes: none of the axes that can be stated is up
    with pytest.raises(MotionError, match="and the head points along -y; turn it so that y or z is up, or state"):
        read_human(upside_down, AUTO, "clip.bvh")


def test_a_stated_unit_gives_way_to_the_legs(tmp_path):
    found = human(write_human(tmp_path / "a.bvh", unit=100.0), LAFAN1)
    assert found.leg == pytest.approx(0.859, abs=1e-3)
    assert found.notes == ("lengths in m and not as map 'lafan1' says, by the legs",)


def test_an_unknown_unit_is_made_from_the_legs(tmp_path):
    found = human(write_human(tmp_path / "a.bvh", unit=1e6), AUTO)
    assert found.leg == pytest.approx(0.84)
    assert (
        "unit of lengths unknown: legs of 8.6e-05 taken as 0.84 m (else: plat motions convert --units)" in found.notes
    )


def exchanged(skeleton: SkeletonMap, *joints: str) -> SkeletonMap:
    """A map with left and right of some joints exchanged."""
    names = dict(skeleton.joints)
    for joint in joints:
        names[f"left_{joint}"], names[f"right_{joint}"] = names[f"right_{joint}"], names[f"left_{joint}"]
    return replace(skeleton, joints=names)


def test_left_and_right_exchanged_is_noticed(tmp_path):
    legs, arms = ("hip", "knee", "ankle", "toe"), ("shoulder", "elbow", "wrist")
    path = write_human(tmp_path / "a.bvh", turns={"LeftUpLeg": (40, 0, 0)})
    with pytest.raises(MotionError, match="toes point behind the pelvis: left and right are exchanged, in"):
        human(path, exchanged(LAFAN1, *legs, *arms))
    with pytest.raises(MotionError, match="shoulders and hips have left and right the other way round"):
        human(path, exchanged(LAFAN1, *arms))
    mocap = read_bvh(path)
    mirrored = replace(mocap, positions=mocap.positions * np.array([-1, 1, 1]))
    with pytest.raises(MotionError, match="toes point behind the pelvis: .* or its axes are left-handed"):
        read_human(mirrored, LAFAN1, "clip.bvh")


def test_a_wrong_joint_shows_in_the_proportions(tmp_path):
    path = write_human(tmp_path / "a.bvh")
    joints = {**LAFAN1.joints, "left_knee": "LeftFoot", "right_knee": "RightFoot"}
    joints |= {"left_ankle": "LeftToe", "right_ankle": "RightToe"}
    with pytest.raises(MotionError, match=r"shin to thigh is 0.\d+, as no human has it; is skeleton map 'mine' right"):
        human(path, replace(LAFAN1, name="mine", joints=joints))


def test_an_animal_with_the_joint_names_of_a_human_is_none(tmp_path):
    mocap = read_bvh(write_human(tmp_path / "a.bvh"))
    parts = ("shoulder", "elbow", "wrist")
    arms = [mocap.names.index(LAFAN1.joints[f"{side}_{part}"]) for side in ("left", "right") for part in parts]
    positions = mocap.positions.copy()
    # an elephant's shoulders are as far from its hips as its feet
    positions[:, arms] += positions[:, [0]] - positions[:, [mocap.names.index("LeftFoot")]]
    with pytest.raises(MotionError, match=r"trunk to leg is 1.\d+, as no human has it"):
        read_human(replace(mocap, positions=positions), LAFAN1, "elephant.bvh")


def test_frames_in_which_a_body_was_lost_are_refused(tmp_path):
    """Zeros for all joints became a crouch at the origin, and made the human smaller."""
    mocap = read_bvh(write_human(tmp_path / "a.bvh"))
    lost = mocap.positions.copy()
    lost[10:12] = 0
    with pytest.raises(
        MotionError, match="legs have 0 times their usual length in frame 11 and 1 more, as where a body"
    ):
        read_human(replace(mocap, positions=lost), LAFAN1, "clip.bvh")


@pytest.mark.parametrize("count", [1, 2])
def test_a_pose_before_the_motion_is_left_out(tmp_path, count):
    mocap = read_bvh(write_human(tmp_path / "a.bvh"))
    posed = mocap.positions.copy()
    posed[:count] -= posed[:1, :1]
    found = read_human(replace(mocap, positions=posed), LAFAN1, "clip.bvh")
    assert len(found.positions["hips"]) == len(found.rotations["left_ankle"]) == 30 - count
    assert "left out: a pose before the motion" in found.notes[0]


def test_a_pose_that_is_held_before_the_motion_is_left_out(tmp_path):
    """A second of it became a clip of use that swings its arms from one into the other."""
    mocap = read_bvh(write_human(tmp_path / "a.bvh", frames=60))
    posed = mocap.positions.copy()
    posed[:40] = posed[0] - posed[0, 0]
    found = read_human(replace(mocap, positions=posed), LAFAN1, "clip.bvh")
    assert found.notes[0] == "first 40 frames left out: a pose before the motion"
    assert len(found.positions["hips"]) == len(found.rotations["left_ankle"]) == 20
    posed[20, :, 1] += 0.5  # who moves while the pose is held is a body, and the leap is another take
    assert len(read_human(replace(mocap, positions=posed), LAFAN1, "clip.bvh").positions["hips"]) == 60
    held = np.tile(mocap.positions[:1], (60, 1, 1))
    assert len(read_human(replace(mocap, positions=held), LAFAN1, "clip.bvh").positions["hips"]) == 60


def test_a_pose_that_is_blended_into_the_motion_is_left_out(tmp_path):
    mocap = replace(read_bvh(write_human(tmp_path / "a.bvh", frames=60)), fps=120.0)
    wrist = mocap.names.index("LeftHand")
    posed = mocap.positions.copy()
    posed[:5, wrist, 1] += np.array([60.0, 45.0, 25.0, 8.0, 1.0])
    found = read_human(replace(mocap, positions=posed), LAFAN1, "clip.bvh")
    assert found.notes[0] == "first 4 frames left out: a pose before the motion"
    # as fast in the middle it is a motion
    posed = mocap.positions.copy()
    posed[30:35, wrist, 1] += np.array([60.0, 45.0, 25.0, 8.0, 1.0])
    assert len(read_human(replace(mocap, positions=posed), LAFAN1, "clip.bvh").positions["hips"]) == 60


def test_axis_and_unit_that_are_stated_overrule_the_motion(tmp_path):
    mocap = read_bvh(write_human(tmp_path / "a.bvh"))
    found = read_human(mocap, AUTO, "a.bvh", up="z", units="cm")
    assert found.positions["neck"][0, 2] - found.positions["left_ankle"][0, 2] == pytest.approx(0, abs=0.3)
    assert read_human(mocap, AUTO, "a.bvh", units="in").leg == pytest.approx(2.54 * read_human(mocap, AUTO, "a").leg)
    feet = read_bvh(write_human(tmp_path / "b.bvh", unit=30.48))
    assert read_human(feet, AUTO, "b.bvh").leg == pytest.approx(0.86, abs=0.01)


def test_a_format_whose_up_axis_is_known_needs_nobody_who_stands(tmp_path):
    """Kimodo's joints are y up: a body that leans far says nothing, and the format does."""
    mocap = turned(read_bvh(write_human(tmp_path / "a.bvh")), Rotation.from_euler("x", 45, degrees=True), (0, 500, 500))
    leaning = replace(mocap, rest=np.zeros_like(mocap.rest))
    with pytest.raises(
        MotionError, match="which axis is up cannot be determined from the poses; state it: plat motions convert --up"
    ):
        read_human(leaning, AUTO, "a.bvh")
    assert read_human(replace(leaning, up="y"), AUTO, "a.bvh").notes == mocap.notes


@pytest.mark.parametrize("turn", [("x", 180), ("z", 90), ("x", -90)], ids=["-y", "-x", "-z"])
def test_a_world_upside_down_is_refused(tmp_path, turn):
    """A walk of 3 m: whose head points along a negative axis lies on a floor, or the axes are others."""
    standing = read_bvh(write_human(tmp_path / "a.bvh"))
    walked = np.linspace(0, 300, len(standing.positions))[:, None, None] * [1.0, 0.0, 0.0]
    walking = turned(replace(standing, positions=standing.positions + walked), Rotation.from_euler(*turn, degrees=True))
    with pytest.raises(MotionError, match="--up"):
        read_human(walking, replace(AUTO, up="y"), "clip.bvh")


@pytest.mark.parametrize("up", ["x", "z"])
def test_who_walks_does_not_lie(tmp_path, up):
    """The middle of the body is as near to 0 along the stated axis as that of who lies."""
    standing = read_bvh(write_human(tmp_path / "a.bvh", up=up))
    along = {"x": 2, "z": 0}[up]
    walked = np.zeros_like(standing.positions)
    walked[..., along] += np.linspace(0, 300, len(walked))[:, None]
    walked[..., 1] -= np.median(standing.positions[..., 1])
    found = read_human(replace(standing, positions=standing.positions + walked), replace(AUTO, up="y"), "clip.bvh")
    assert found.notes == (f"{up} up and not y, as stated: the body stands along it",)


def test_hips_in_another_unit_than_the_skeleton_are_refused(tmp_path):
    standing = read_bvh(write_human(tmp_path / "a.bvh"))
    flown = standing.positions + np.linspace(0, 3e4, len(standing.positions))[:, None, None] * [1.0, 0.0, 0.0]
    with pytest.raises(MotionError, match="hips go at 310 m/s; is their place in another unit than the skeleton"):
        read_human(replace(standing, positions=flown), AUTO, "clip.bvh")
