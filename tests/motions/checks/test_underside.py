import mujoco
import numpy as np

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
