from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from plat.deploy import SoleKinematics
from plat.errors import RobotError
from plat.motions.checks.feet import Soles
from plat.motions.checks.underside import Underside
from plat.robots import G1, Robot, describe_robot, get_robot
from plat.robots.sole_points import sole_points, touching_points

TOY = Path(__file__).parent / "toy.json"
BOX = '<geom type="box" size="0.1 0.05 0.02" pos="0.03 0 -0.04" friction="0.9"/>'
MESH = (
    '<asset><mesh name="sole" vertex="-.07 -.05 -.06 .13 -.05 -.06 -.07 .05 -.06 .13 .05 -.06 '
    '-.05 -.03 -.02 .1 -.03 -.02 -.05 .03 -.02 .1 .03 -.02 .16 0 -.04"/></asset>'
)
CORNERS = sorted((x, y, -0.06) for x in (-0.07, 0.13) for y in (-0.05, 0.05))


def with_feet(folder: Path, geom: str, quat: str = "1 0 0 0", asset: str = "") -> Robot:
    """The toy on other feet, and the frames of its feet turned under them."""
    text = TOY.with_suffix(".xml").read_text()
    assert text.count(BOX) == 2
    text = text.replace(BOX, geom).replace("<worldbody>", f"{asset}<worldbody>")
    for side in "lr":
        paw = f'<body name="paw_{side}" pos="0 0 -0.3"'
        assert paw in text
        text = text.replace(paw, f'{paw} quat="{quat}"')
    (folder / "toy.xml").write_text(text)
    return replace(get_robot(TOY), name="shod", asset=str(folder / "toy.xml"))


@pytest.mark.parametrize(
    ("geom", "touching"),
    [
        (BOX, CORNERS),
        (f'{BOX}<geom type="sphere" size="0.01" pos="0.14 0 -0.05"/>', [*CORNERS, (0.14, 0, -0.06)]),
        ('<geom type="capsule" size="0.02" fromto="-0.05 0 -0.04 0.1 0 -0.04"/>', [(-0.05, 0, -0.06), (0.1, 0, -0.06)]),
        ('<geom type="mesh" mesh="sole"/>', CORNERS),
    ],
)
def test_points_that_touch_a_level_floor(tmp_path, geom, touching):
    robot = with_feet(tmp_path, geom, asset=MESH)
    left, right = touching_points(robot, robot.model())
    np.testing.assert_allclose(sorted(left.round(6).tolist()), sorted(touching), atol=1e-6)
    np.testing.assert_allclose(left, right, atol=1e-9)
    feet = describe_robot(robot, 0.02).feet
    assert [foot.body for foot in feet] == ["paw_l", "paw_r"]
    points, jacobian = SoleKinematics(describe_robot(robot, 0.02))(robot.default_joint_pos.numpy())
    assert points.shape == (2 * len(touching), 3)
    assert jacobian.shape == (2 * len(touching), 3, 7)
    assert np.ptp(points[:, 2]) < 1e-3  # it stands flat in its default pose


def test_a_foot_whose_frame_is_turned_against_its_sole_touches_with_all_of_it(tmp_path):
    """Its frame is pitched by half a radian: down its nearest axis is one edge."""
    tilt = np.array([np.cos(0.25), 0.0, np.sin(0.25), 0.0])
    back = " ".join(f"{value:.9f}" for value in tilt * [1, -1, -1, -1])
    place = np.empty(3)
    mujoco.mju_rotVecQuat(place, np.array([0.03, 0.0, -0.04]), tilt * [1, -1, -1, -1])
    geom = BOX.replace('pos="0.03 0 -0.04"', f'pos="{" ".join(f"{value:.9f}" for value in place)}" quat="{back}"')
    robot = with_feet(tmp_path, geom, quat=" ".join(f"{value:.9f}" for value in tilt))
    # its ankle's axis is the same, so it stands as before
    left, _ = touching_points(robot, robot.model())
    in_world = []
    for point in left:
        turned = np.empty(3)
        mujoco.mju_rotVecQuat(turned, point, tilt)
        in_world.append(turned)
    np.testing.assert_allclose(sorted(np.round(in_world, 6).tolist()), CORNERS, atol=1e-5)


def test_a_cylinder_touches_with_its_lower_rim(tmp_path):
    robot = with_feet(tmp_path, '<geom type="cylinder" size="0.05 0.02" pos="0 0 -0.04"/>')
    left, _ = touching_points(robot, robot.model())
    np.testing.assert_allclose(np.linalg.norm(left[:, :2], axis=1), 0.05)
    np.testing.assert_allclose(left[:, 2], -0.06)


def test_down_is_where_the_foot_stands_not_an_axis_of_its_frame(tmp_path):
    """The frame of the feet is turned by a quarter about y: their x points down."""
    robot = with_feet(tmp_path, '<geom type="box" size="0.02 0.05 0.1" pos="0.04 0 0.03"/>', "0.7071068 0 0.7071068 0")
    robot = replace(robot, default_pose={})
    left, _ = touching_points(robot, robot.model())
    np.testing.assert_allclose(left[:, 0], 0.06, atol=1e-6)
    assert len(left) == 4


@pytest.mark.parametrize(
    "geom",
    [
        BOX,
        '<geom type="capsule" size="0.02" fromto="-0.05 0 -0.04 0.1 0 -0.04"/>',
        '<geom type="sphere" size="0.05"/>',
        '<geom type="mesh" mesh="sole"/>',
    ],
)
def test_the_lowest_point_of_a_sole_is_the_lowest_of_its_geoms(tmp_path, geom):
    """By MuJoCo's own distance from the floor, in any pose."""
    robot = with_feet(tmp_path, geom, asset=MESH)
    model, rng = robot.model(), np.random.default_rng(0)
    data, (floor,) = mujoco.MjData(model), np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
    for _ in range(5):
        qpos = np.concatenate(([0, 0, 2], rng.normal(size=4), rng.uniform(-0.5, 0.5, 7)))
        qpos[3:7] /= np.linalg.norm(qpos[3:7])
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        low = Soles(robot).points(torch.from_numpy(qpos)[None])[0, ..., 2].amin(-1)
        for foot, height in zip(robot.sole_geoms(model)[:, 0], low.tolist(), strict=True):
            distance = mujoco.mj_geomDistance(model, data, int(floor), int(foot), 10.0, None)
            assert height == pytest.approx(distance, abs=1e-6)


def test_an_ellipsoid_has_no_such_points(tmp_path):
    robot = with_feet(tmp_path, '<geom type="ellipsoid" size="0.1 0.05 0.02"/>')
    description = describe_robot(robot, 0.02)
    assert description.feet == ()
    with pytest.raises(RobotError, match="has no feet: export the bundle again, with contact geoms .* are spheres"):
        SoleKinematics(description)
    with pytest.raises(RobotError, match="'shod': a contact geom of 'paw_l' is no sphere, capsule, cylinder, box or"):
        Soles(robot)


def test_feet_of_different_kinds_are_named(tmp_path):
    robot = with_feet(tmp_path, BOX)
    text = Path(robot.asset).read_text()
    Path(robot.asset).write_text(text.replace(BOX, '<geom size="0.03"/>', 1))
    with pytest.raises(RobotError, match="contact geoms of 'paw_l' and 'paw_r' are of different kinds, expected"):
        sole_points(replace(robot), robot.model())


def test_those_of_the_g1_are_its_spheres():
    model = G1.model()
    centers, radii = sole_points(G1, model)
    geoms = G1.sole_geoms(model)
    np.testing.assert_array_equal(centers, model.geom_pos[geoms])
    np.testing.assert_array_equal(radii, model.geom_size[geoms, 0])


def test_a_cylinder_is_as_low_as_the_box_around_it(tmp_path):
    robot = with_feet(tmp_path, '<geom type="cylinder" size="0.05 0.02" pos="0 0 -0.04"/>')
    underside = Underside(robot)
    heights = underside.heights(robot.default_qpos[None])[0]
    low = Soles(robot).points(torch.from_numpy(robot.default_qpos)[None])[0, 0, :, 2].min()
    assert heights[underside.bodies.index("paw_l")] == pytest.approx(float(low), abs=1e-3)
