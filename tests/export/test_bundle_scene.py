import dataclasses

import mujoco
import numpy as np

from plat.export.bundle_scene import scene_xml
from plat.robots import G1


def test_the_scene_is_the_robot_that_policies_are_trained_on():
    ours, theirs = mujoco.MjModel.from_xml_string(scene_xml(G1)), G1.model()
    for field in ("body_mass", "body_inertia", "jnt_range", "actuator_gainprm", "actuator_biasprm", "geom_friction"):
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), rtol=1e-5, atol=1e-9)  # six digits
    assert ours.opt.timestep == theirs.opt.timestep
    a, b = mujoco.MjData(ours), mujoco.MjData(theirs)
    for model, data in ((ours, a), (theirs, b)):
        data.qpos[:] = G1.default_qpos
        data.ctrl[:] = G1.default_joint_pos
        mujoco.mj_step(model, data, 40)
    np.testing.assert_allclose(a.qpos, b.qpos, atol=1e-3)


def test_a_robot_with_meshes_has_none(tmp_path):
    (tmp_path / "cube.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    xml = G1.asset_path.read_text().replace(
        "<worldbody>", '<asset><mesh name="cube" file="cube.obj"/></asset><worldbody>', 1
    )
    (tmp_path / "g1.xml").write_text(xml)
    assert scene_xml(dataclasses.replace(G1, asset=str(tmp_path / "g1.xml"))) is None
