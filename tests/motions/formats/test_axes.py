import numpy as np
import pytest
import torch

from plat.motions import MotionClip
from plat.motions.checks.feet import Soles
from plat.motions.checks.underside import Underside
from plat.motions.formats.axes import z_up
from plat.motions.formats.units import place_in_meters
from plat.robots import G1
from plat.rotations import quat_multiply
from tests.motions.formats.writers import bowing_clip, turned

SOLES = Soles(G1)
QPOS = bowing_clip(heading=0.4).qpos.astype(np.float64)
PLACE, QUAT, JOINTS = QPOS[:, :3], QPOS[:, 3:7], QPOS[:, 7:]


def test_what_is_right_stays_as_it_is():
    for found, values in zip(z_up(PLACE, QUAT, JOINTS, SOLES), (PLACE, QUAT), strict=True):
        assert found.notes == ()
        np.testing.assert_array_equal(found.values, values)


@pytest.mark.parametrize("unit", [1, 100])
def test_a_world_whose_y_axis_is_up(unit):
    half = np.sqrt(0.5)
    turn = torch.tensor([half, -half, 0, 0], dtype=torch.float64).expand(len(QUAT), 4)
    quat = quat_multiply(turn, torch.from_numpy(QUAT)).numpy()
    place = unit * np.stack((PLACE[:, 0], PLACE[:, 2], -PLACE[:, 1]), 1)
    upright, turned = z_up(place, quat, JOINTS, SOLES)
    np.testing.assert_allclose(upright.values, unit * PLACE, atol=1e-9)
    np.testing.assert_allclose(turned.values, QUAT, atol=1e-9)
    assert upright.notes == ("y axis up in the file, turned to z",)


def test_who_lies_stays_lying():
    quat = np.tile([np.sqrt(0.5), 0, np.sqrt(0.5), 0], (len(QUAT), 1))
    place = np.tile([0.0, 0.0, 0.1], (len(QUAT), 1))
    assert z_up(place, quat, JOINTS, SOLES)[0].notes == ()
    assert place_in_meters(place, quat, JOINTS, SOLES, "pos").notes == ()


def test_a_world_whose_x_axis_is_up():
    half = np.sqrt(0.5)
    turn = torch.tensor([half, 0, half, 0], dtype=torch.float64).expand(len(QUAT), 4)
    quat = quat_multiply(turn, torch.from_numpy(QUAT)).numpy()
    place = np.stack((PLACE[:, 2], PLACE[:, 1], -PLACE[:, 0]), 1)
    upright, turned = z_up(place, quat, JOINTS, SOLES)
    np.testing.assert_allclose(upright.values, PLACE, atol=1e-9)
    np.testing.assert_allclose(turned.values, QUAT, atol=1e-9)
    assert upright.notes == ("x axis up in the file, turned to z",)


def test_an_axis_that_is_stated_is_up():
    quat = np.tile([1.0, 0, 0, 0], (len(QUAT), 1))
    upright, turned = z_up(PLACE, quat, JOINTS, SOLES, "y")
    np.testing.assert_allclose(upright.values, np.stack((PLACE[:, 0], -PLACE[:, 2], PLACE[:, 1]), 1))
    assert abs(turned.values[0, 1]) > 0.7
    assert z_up(PLACE, quat, JOINTS, SOLES, "z")[0].values is PLACE


@pytest.mark.parametrize("unit", [1, 100])
@pytest.mark.parametrize(
    ("place", "vector", "told"),
    [
        ([1, 2, 0], [2, 3, 1], "y up and z forward in the file, of the root as well"),
        ([-1, 2, 0], [2, -3, -1], "y up, z forward and left-handed axes in the file"),
    ],
    ids=["right-handed", "left-handed"],
)
def test_axes_that_are_named_otherwise_in_world_and_root(unit, place, vector, told):
    qpos = walking()
    signs = np.where(np.array(place) < 0, -1, 1)
    places = unit * qpos[:, np.abs(place)] * signs
    quats = np.column_stack((qpos[:, 3], *(np.sign(column) * qpos[:, 3 + abs(column)] for column in vector)))
    upright, facing = z_up(places, quats, qpos[:, 7:], SOLES)
    assert upright.notes == (told,)
    np.testing.assert_allclose(upright.values, unit * qpos[:, :3], atol=1e-6)
    np.testing.assert_allclose(facing.values, qpos[:, 3:7], atol=1e-6)


@pytest.mark.parametrize("turn", ["back", "front", "side"])
def test_who_lies_beside_the_origin_stays_lying(turn):
    """As far from an axis of the world as a standing robot is high, or about so."""
    half = 0.5**0.5
    quat = {"back": [half, 0, -half, 0], "front": [half, 0, half, 0], "side": [half, half, 0, 0]}[turn]
    qpos = np.concatenate((np.tile([0, 0, 1.0], (len(QUAT), 1)), np.tile(quat, (len(QUAT), 1)), 0 * JOINTS), 1)
    qpos[:, 2] -= Underside(G1).heights(qpos[:1]).min()
    for beside in (0.6, 0.9):
        for axis in (0, 1):
            qpos[:, :2] = 0.0
            qpos[:, axis] = beside
            assert z_up(qpos[:, :3], qpos[:, 3:7], qpos[:, 7:], SOLES)[0].notes == ()


def walking() -> np.ndarray:
    """A sway from side to side over a foot that stands still, so that exchanged axes show."""
    qpos = np.tile(G1.default_qpos, (60, 1)).astype(np.float64)
    time = np.linspace(0, 1, 60)
    roll = 0.2 * np.sin(6 * time) + 0.1
    qpos[:, 3], qpos[:, 4] = np.cos(roll / 2), np.sin(roll / 2)
    for side in ("left", "right"):
        qpos[:, 7 + G1.joint_names.index(f"{side}_hip_roll")] -= roll
    qpos[:, 2] -= SOLES.points(torch.from_numpy(qpos))[..., 2].amin((1, 2)).numpy()
    qpos[:, :2] += [1.5, 0.3] - SOLES.points(torch.from_numpy(qpos))[:, 0, :, :2].mean(1).numpy()
    return turned(MotionClip("sway", qpos, 50.0), 0.3).qpos.astype(np.float64)
