from dataclasses import replace

import mujoco
import numpy as np
import pytest

from plat.motions import MotionClip, ground_feet, validate_motion
from plat.motions.checks.underside import Underside
from plat.robots import G1


def lying(height: float = 0.0, frames: int = 40) -> np.ndarray:
    """On the back, with the lowest part at a height."""
    qpos = np.tile(G1.default_qpos, (frames, 1))
    qpos[:, 3:7] = [np.sqrt(0.5), 0, -np.sqrt(0.5), 0]
    qpos[:, 2] += height - Underside(G1).heights(qpos).min()
    return qpos


def test_heights_are_those_that_mujoco_has():
    qpos = lying(0.3, 2)
    qpos[1, 7:] += 0.2
    model, data = G1.shared_model, mujoco.MjData(G1.shared_model)
    underside = Underside(G1)
    for pose, heights in zip(qpos, underside.heights(qpos), strict=True):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        lowest, body = underside.lowest(data)
        np.testing.assert_allclose(lowest, heights.min(), atol=1e-6)
        assert body == underside.bodies[int(heights.argmin())]
        # by the distance to a plane far below, from MuJoCo's own collision
        geoms = np.flatnonzero((model.geom_contype != 0) & (model.geom_bodyid > 0))
        ends = data.geom_xpos[geoms, 2] - np.abs(data.geom_xmat[geoms, 8]) * np.where(
            model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_CAPSULE, model.geom_size[geoms, 1], 0
        )
        np.testing.assert_allclose(heights, ends - model.geom_size[geoms, 0], atol=1e-6)


def test_who_lies_on_the_floor_does_not_float_and_is_not_pushed_into_it():
    clip = MotionClip("lying", lying(), 30.0)
    report = validate_motion(clip)
    assert abs(report.floating) < 1e-3
    assert not any("float" in reason or "floor" in reason or "exchanged" in reason for reason in report.reasons)
    np.testing.assert_allclose(ground_feet(clip).qpos, clip.qpos, atol=1e-3)
    lifted = MotionClip("lying", lying(0.2), 30.0)
    assert abs(validate_motion(lifted).floating - 0.2) < 1e-3
    np.testing.assert_allclose(ground_feet(lifted).qpos[:, 2], clip.qpos[:, 2], atol=1e-3)


def test_the_part_that_is_under_the_floor_is_named():
    report = validate_motion(MotionClip("sunk", lying(-0.1), 30.0))
    assert report.verdict in ("repair", "drop")
    assert any("10.0 cm under the floor" in reason and "foot" not in reason for reason in report.reasons)


FOOT = "-.06 -.04 -.04  -.06 .04 -.04  .12 -.04 -.04  .12 .04 -.04  -.02 -.02 .1  -.02 .02 .1  .02 -.02 .1  .02 .02 .1"


@pytest.mark.parametrize(
    "shape",
    [
        'type="mesh" mesh="foot"',
        'type="cylinder" size=".05 .04" pos="0 0 -.01"',
        'type="ellipsoid" size=".1 .05 .03" pos=".02 0 -.01"',
        'type="box" size=".1 .05 .03" pos=".02 0 -.01"',
    ],
)
def test_the_lowest_point_of_every_shape_is_its_own(tmp_path, shape):
    """A box about the middle of a mesh's mass went centimeters below a sole that it is above."""
    spec = G1.spec()
    spec.delete(spec.geom("floor"))
    for foot in G1.feet:
        for geom in list(spec.body(foot).geoms):
            spec.delete(geom)
    spec.compile()
    text = spec.to_xml().replace("<asset>", f'<asset><mesh name="foot" vertex="{FOOT}"/>')
    for foot in G1.feet:
        head, body, tail = text.partition(f'<body name="{foot}"')
        text = head + body + tail.replace("</body>", f"<geom {shape}/></body>", 1)
    (tmp_path / "robot.xml").write_text(text)
    robot = replace(G1, asset=str(tmp_path / "robot.xml"))
    model, rng = robot.model(), np.random.default_rng(0)
    data, underside = mujoco.MjData(model), Underside(robot)
    qpos = np.tile(robot.default_qpos, (20, 1))
    qpos[:, 2] = 3.0
    qpos[1:, 3:7] = rng.normal(size=(19, 4))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    floor = model.geom("floor").id
    for pose, heights in zip(qpos, underside.heights(qpos), strict=True):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        for foot in robot.feet:
            (geom,) = (geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == model.body(foot).id)
            distance = mujoco.mj_geomDistance(model, data, geom, floor, 10.0, None)
            assert heights[underside.bodies.index(foot)] == pytest.approx(distance, abs=1e-4)
        assert underside.lowest(data)[0] == pytest.approx(heights.min(), abs=1e-6)
