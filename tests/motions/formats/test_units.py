import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions.checks.feet import Soles
from plat.motions.formats.units import angles_in_radians, place_in_meters, unit_quaternions
from plat.robots import G1, get_robot
from tests.motions.formats.writers import bowing_clip

SOLES = Soles(G1)
QPOS = bowing_clip(heading=0.4).qpos.astype(np.float64)
PLACE, QUAT, JOINTS = QPOS[:, :3], QPOS[:, 3:7], QPOS[:, 7:]


def test_what_is_right_stays_as_it_is():
    assert unit_quaternions(QUAT, "rot").notes == ()
    for found, values in (
        (angles_in_radians(JOINTS, G1), JOINTS),
        (place_in_meters(PLACE, QUAT, JOINTS, SOLES, "pos"), PLACE),
    ):
        assert found.notes == ()
        np.testing.assert_array_equal(found.values, values)


@pytest.mark.parametrize(
    ("factor", "unit"), [(100, "centimeters"), (1000, "millimeters"), (1 / 0.0254, "inches"), (1 / 0.3048, "feet")]
)
def test_places_in_other_units(factor, unit):
    found = place_in_meters(factor * PLACE, QUAT, JOINTS, SOLES, "pos")
    np.testing.assert_allclose(found.values, PLACE)
    assert f"root position in {unit}" in found.notes[0]


def test_a_height_in_no_unit_is_refused():
    with pytest.raises(MotionError, match="'pos' has the root 10.* above the floor, expected meters: the legs"):
        place_in_meters(PLACE + np.array([0, 0, 10]), QUAT, JOINTS, SOLES, "pos")
    with pytest.raises(MotionError, match="'pos' has values up to 5e[+]04, expected meters"):
        place_in_meters(PLACE + np.array([5e4, 0, 0]), QUAT, JOINTS, SOLES, "pos")


@pytest.mark.parametrize("height", [-0.7, 0.0, 0.15, 1.0])
def test_floating_and_sunk_clips_are_in_meters(height):
    assert place_in_meters(PLACE + np.array([0, 0, height]), QUAT, JOINTS, SOLES, "pos").notes == ()


def test_legs_folded_below_a_leaning_trunk_are_no_measure():
    """Hips and knees as of someone who reaches for the floor: were the trunk upright, the feet would be beside it."""
    folded = JOINTS.copy()
    for joint, angle in (("hip_pitch", -2.5), ("knee", 1.0)):
        folded[:, [G1.joint_names.index(f"{side}_{joint}") for side in ("left", "right")]] = angle
    place = PLACE * [1, 1, 0] + [0, 0, 0.6]
    assert place_in_meters(place, QUAT, folded, SOLES, "pos").notes == ()


def test_degrees():
    found = angles_in_radians(np.rad2deg(JOINTS), G1)
    np.testing.assert_allclose(found.values, JOINTS)
    assert found.notes == ("joint angles in degrees",)
    with pytest.raises(MotionError, match="'joint angles' has values up to 5.*, expected radians"):
        angles_in_radians(np.rad2deg(JOINTS) + 500, G1)


@pytest.mark.parametrize("length", [0.82, 0.96, 1.04, 1.2])
def test_quaternions_that_were_averaged(length):
    found = unit_quaternions(length * QUAT, "rot")
    np.testing.assert_allclose(found.values, QUAT, atol=1e-7)
    assert f"root quaternions of length {length:.3f} to {length:.3f} made unit" in found.notes


@pytest.mark.parametrize("length", [0.0, 0.5, 2.0])
def test_what_cannot_be_a_quaternion_is_refused(length):
    quat = QUAT.copy()
    quat[7] *= length
    with pytest.raises(MotionError, match=rf"quaternion of frame 7 \(rot\) has length {length:g}, expected 1"):
        unit_quaternions(quat, "rot")


def test_folded_legs_are_no_reason_to_doubt_the_unit():
    joints = np.tile(G1.default_joint_pos.double().numpy(), (30, 1))
    for side in ("left", "right"):
        joints[:, G1.joint_names.index(f"{side}_hip_pitch")] = -2.4
        joints[:, G1.joint_names.index(f"{side}_knee")] = 2.6
    place = np.tile([0.0, 0.0, 0.6], (30, 1))
    assert place_in_meters(place, QUAT[:30], joints, SOLES, "pos").notes == ()


def test_who_walks_high_up_in_meters_stays_there():
    """On stairs or a table the feet rest in meters; read in feet they would slide."""
    place = PLACE + np.array([0, 0, 1.2])
    assert place[:, 2].min() > 1.6
    assert place_in_meters(place, QUAT, JOINTS, SOLES, "pos").notes == ()


def test_a_unit_that_is_stated_is_taken():
    found = place_in_meters(PLACE, QUAT, JOINTS, SOLES, "pos", "cm")
    np.testing.assert_allclose(found.values, 0.01 * PLACE)


def test_small_angles_in_degrees_are_known_by_many_joints_beyond_their_limits():
    small = 0.2 * (JOINTS - JOINTS.mean(0)) + 0.08
    assert np.rad2deg(small).max() < 4 * np.pi
    assert angles_in_radians(np.rad2deg(small), G1).notes == ("joint angles in degrees",)
    jumping = np.rad2deg(small)
    jumping[::2] += 5.5  # in degrees this would hardly be seen
    with pytest.raises(MotionError, match="'joint angles' has steps of about 6.28 beyond the joints' limits, expected"):
        angles_in_radians(jumping, G1)


WRISTS = [index for index, name in enumerate(G1.joint_names) if "wrist" in name]


@pytest.mark.parametrize("joints", [[0], WRISTS, [*range(29)]])
@pytest.mark.parametrize("broken", [False, True])
def test_whole_turns_are_taken_off(joints, broken):
    """Angles from 0 to 2 pi were taken for degrees, and shrunk; also where a frame is broken."""
    swinging = JOINTS + 0.1 * np.sin(np.arange(40))[:, None]  # some through 0
    low, high = G1.joint_range.double().numpy().T
    swinging = swinging.clip(low, high)
    wrapped = swinging.copy()
    wrapped[:, joints] = np.mod(wrapped[:, joints], 2 * np.pi)
    if broken:
        wrapped[20, 15:20] = swinging[20, 15:20] + 3.5
    found = angles_in_radians(wrapped, G1)
    rest = np.arange(40) != 20
    right = np.isclose(found.values[rest], swinging[rest], atol=1e-9)
    # a joint that is beyond its limits for moments alone, and broken in one of them, is left to the checks
    assert right.mean() > (0.99 if broken else 0.9999)
    assert broken or found.notes[0].startswith("whole turns taken off ")
    assert np.abs(found.values[20]).max() > 2 if broken else np.allclose(found.values[20], swinging[20])


@pytest.mark.parametrize("offset", [3.5, np.pi, -5.0, 100.0])
@pytest.mark.parametrize("joints", [slice(15, 20), slice(0, 29)])
def test_a_broken_frame_makes_no_degrees(offset, joints):
    broken = JOINTS.copy()
    broken[7, joints] += offset
    found = angles_in_radians(broken, G1)
    assert found.notes == ()
    np.testing.assert_array_equal(found.values, broken)


def lying(height: float = 0.12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Who creeps on the back."""
    place = np.linspace([0.0, 0, height], [1.0, 0, height], 30)
    quat = np.tile([np.sqrt(0.5), 0, -np.sqrt(0.5), 0], (30, 1))
    return place, quat, np.tile(0.3 * G1.default_joint_pos.double().numpy(), (30, 1))


@pytest.mark.parametrize("header", [None, "mm", "cm", "in"])
def test_the_unit_of_who_lies_is_that_in_which_the_floor_is_below(header):
    """Over the legs' reach, 90 mm are as high as 90 cm."""
    place, quat, joints = lying(0.09)
    factors = {"mm": (1000, "millimeters"), "cm": (100, "centimeters"), "in": (1 / 0.0254, "inches")}
    for unit, (factor, name) in factors.items():
        if header not in (None, unit):
            continue
        found = place_in_meters(factor * place, quat, joints, SOLES, "pos", written=header)
        np.testing.assert_allclose(found.values, place)
        assert found.notes == (f"root position in {unit}, as the file says",) or name in found.notes[0]


def test_who_lies_on_the_floor_in_no_unit_is_doubtful():
    place, quat, joints = lying(0.3)
    told = "the unit of places cannot be determined: 'pos' has the root of a robot that lies at 30, and .* in no unit"
    assert re.match(told, place_in_meters(100 * place, quat, joints, SOLES, "pos").doubt)
    assert re.match(told, place_in_meters(100 * place, quat, joints, SOLES, "pos", written="m").doubt)
    for found in (
        place_in_meters(100 * place, quat, joints, SOLES, "pos", "cm"),
        place_in_meters(place, quat, joints, SOLES, "pos"),
    ):
        assert (found.notes, found.doubt) == ((), "")


@pytest.mark.parametrize(
    ("factor", "unit"), [(100, "centimeters"), (1000, "millimeters"), (1 / 0.0254, "inches"), (1 / 0.3048, "feet")]
)
def test_places_of_a_small_robot_in_other_units(tmp_path, factor, unit):
    """It stands at 0.3 m: 0.98 feet were taken for meters, 30 cm for inches."""
    toy = get_robot(Path(__file__).parents[2] / "robots" / "toy.json")
    spec = mujoco.MjSpec.from_file(str(toy.asset_path))
    for part in (*spec.bodies, *spec.geoms):
        part.pos = 0.42 * part.pos
    for geom in spec.geoms:
        geom.size, geom.fromto = 0.42 * geom.size, 0.42 * geom.fromto
    spec.compile()
    (tmp_path / "robot.xml").write_text(spec.to_xml())
    small = replace(toy, name="small", asset=str(tmp_path / "robot.xml"), root_height=0.42 * toy.root_height)
    qpos = np.tile(small.default_qpos, (40, 1))
    place = qpos[:, :3] + [[0.2, 0.0, 0.0]]
    found = place_in_meters(factor * place, qpos[:, 3:7], qpos[:, 7:], Soles(small), "pos")
    assert found.notes[0].startswith(f"root position in {unit}: ")
    np.testing.assert_allclose(found.values, place, atol=1e-9)
