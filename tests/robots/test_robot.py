import math
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from plat.errors import RobotError
from plat.robots import G1, ForwardKinematics, Robot, without_side

# armature (kg m^2) and effort limit (N m) of each joint, from the motors
MOTORS = {
    ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll"): (0.003609725, 25),
    ("hip_pitch", "hip_yaw", "waist_yaw"): (0.01017752, 88),
    ("hip_roll", "knee"): (0.025101925, 139),
    ("wrist_pitch", "wrist_yaw"): (0.00425, 5),
    ("ankle_pitch", "ankle_roll", "waist_roll", "waist_pitch"): (0.00721945, 50),
}


def motor(joint: str) -> tuple[float, int]:
    return next(figures for names, figures in MOTORS.items() if joint.split("_", 1)[1] in names or joint in names)


@pytest.fixture(scope="module")
def unitree(shared_data) -> mujoco.MjModel:
    """Unitree's own description without the mesh files, which are not there."""
    xml = (shared_data / "g1" / "g1.xml").read_text()
    xml = re.sub(r"<asset>.*?</asset>", "", xml, flags=re.S)
    return mujoco.MjModel.from_xml_string(re.sub(r'<geom[^>]*class="visual"[^>]*/>', "", xml, flags=re.S))


def test_bodies_equal_unitrees(unitree):
    ours = G1.model()
    assert [ours.body(i).name for i in range(ours.nbody)] == [unitree.body(i).name for i in range(unitree.nbody)]
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_parentid"):
        np.testing.assert_allclose(getattr(ours, field), getattr(unitree, field), atol=1e-6)


def test_joints_equal_unitrees(unitree):
    ours = G1.model()
    assert [ours.joint(i).name for i in range(1, 30)] == [unitree.joint(i).name for i in range(1, 30)]
    np.testing.assert_allclose(ours.jnt_range[1:], unitree.jnt_range[1:], atol=1e-6)
    np.testing.assert_allclose(ours.jnt_axis[1:], unitree.jnt_axis[1:], atol=1e-6)


def test_forward_kinematics_equals_unitrees(unitree):
    rng = np.random.default_rng(0)
    data = mujoco.MjData(unitree)
    kinematics = ForwardKinematics(G1, tuple(unitree.body(i).name for i in range(1, unitree.nbody)))
    for _ in range(20):
        qpos = np.concatenate((rng.normal(size=7), rng.uniform(unitree.jnt_range[1:, 0], unitree.jnt_range[1:, 1])))
        qpos[3:7] /= np.linalg.norm(qpos[3:7])
        data.qpos[:] = qpos
        mujoco.mj_kinematics(unitree, data)
        pos, quat = kinematics(*torch.from_numpy(qpos).split((3, 4, 29)))
        np.testing.assert_allclose(pos, data.xpos[1:], atol=1e-6)
        np.testing.assert_allclose(np.abs((quat.numpy() * data.xquat[1:]).sum(-1)), 1, atol=1e-6)


@pytest.mark.parametrize("feet", ["spheres", "capsules"])
def test_mass_is_the_g1s(feet):
    assert G1.model(feet).body_mass.sum() == pytest.approx(33.341, abs=5e-4)


def test_gains_and_limits_are_the_motors():
    omega, zeta = 2 * math.pi * 10, 2
    for index, joint in enumerate(G1.joint_names):
        armature, effort = motor(joint)
        assert G1.model().dof_armature[6 + index] == pytest.approx(armature)
        assert G1.effort_limit[index] == effort
        assert G1.stiffness[index].item() == pytest.approx(armature * omega**2, rel=1e-6)
        assert G1.damping[index].item() == pytest.approx(2 * zeta * armature * omega, rel=1e-6)
    torch.testing.assert_close(G1.action_scale, 0.25 * G1.effort_limit / G1.stiffness)


def test_joint_order():
    leg = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
    arm = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
    expected = [f"{side}_{joint}" for side in ("left", "right") for joint in leg]
    expected += ["waist_yaw", "waist_roll", "waist_pitch"]
    expected += [f"{side}_{joint}" for side in ("left", "right") for joint in arm]
    assert list(G1.joint_names) == expected


def test_default_pose_stands_on_both_soles():
    model = G1.model()
    data = mujoco.MjData(model)
    data.qpos[:] = G1.default_qpos
    mujoco.mj_kinematics(model, data)
    heights = [
        data.geom_xpos[i, 2] - model.geom_size[i, 0] for i in range(model.ngeom) if "_foot" in model.geom(i).name
    ]
    assert len(heights) == 8
    assert all(0 <= height < 0.005 for height in heights)


def test_soles_touch_the_same_ground():
    lowest = {}
    for feet, count in (("spheres", 4), ("capsules", 7)):
        model = G1.model(feet)
        soles = G1.sole_geoms(model)[0]
        assert len(soles) == count
        lowest[feet] = min(model.geom_pos[i, 2] - model.geom_size[i, 0] for i in soles)
    assert lowest["spheres"] == pytest.approx(lowest["capsules"], abs=1e-6)


@pytest.mark.parametrize(
    ("feet", "name", "count"), [("spheres", "{}_foot{}_collision", 4), ("capsules", "{}_ankle_roll_link_sole{}", 7)]
)
def test_sole_geoms_are_the_collision_geoms_of_the_feet(feet, name, count):
    model = G1.model(feet)
    soles = G1.sole_geoms(model)
    for side, geoms in zip(("left", "right"), soles, strict=True):
        assert [model.geom(i).name for i in geoms] == [name.format(side, n) for n in range(1, count + 1)]
        assert (model.geom_friction[geoms, 0] == 0.8).all()  # of the class of the geoms that they replace


def test_only_shared_models_are_shared():
    assert G1.shared_model is G1.shared_model
    assert G1.model() is not G1.model()


def test_names_without_their_side():
    assert [without_side(name) for name in ("left_knee", "right_hip_roll", "waist_roll", "upright_x")] == [
        "knee",
        "hip_roll",
        "waist_roll",
        "upright_x",
    ]


def test_default_pose_has_no_self_contact():
    model = G1.model()
    data = mujoco.MjData(model)
    data.qpos[:] = G1.default_qpos
    mujoco.mj_forward(model, data)
    assert not data.ncon


def test_unknown_names_are_refused():
    with pytest.raises(RobotError, match="body 'tail' is not in g1.xml"):
        Robot("g1", "g1.xml", 0.76, {}, ("pelvis", "tail"), "pelvis", (), G1.feet).model()
    names = ("pelvis", *G1.feet), "pelvis", (), G1.feet
    with pytest.raises(RobotError, match="left_wing"):
        _ = Robot("g1", "g1.xml", 0.76, {"left_wing": 1.0}, *names).default_joint_pos
    with pytest.raises(RobotError, match="expected 'spheres' or 'capsules'"):
        G1.model("boots")


def test_the_physics_step_is_chosen():
    assert G1.model(timestep=0.01).opt.timestep == 0.01
    assert G1.model().opt.timestep == 0.005


def test_a_default_pose_beyond_the_limits_is_refused():
    low, high = G1.joint_range[G1.joint_names.index("left_knee")].tolist()
    degrees = replace(G1, default_pose={**G1.default_pose, "left_knee": 38.3})
    message = rf"robot 'g1': default_pose: 'left_knee' at 38.3 rad, .* its limits, {low:g} to {high:g} rad"
    with pytest.raises(RobotError, match=message):
        _ = degrees.default_joint_pos
    at_the_stop = replace(G1, default_pose={"left_knee": high + 0.01})
    assert at_the_stop.default_joint_pos.max() == pytest.approx(high + 0.01)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"root_height": -0.76}, "robot 'g1': root_height is -0.76, expected a number above 0 and at most 5"),
        ({"root_height": math.nan}, "robot 'g1': root_height is nan, expected a number"),
        ({"default_pose": {"left_knee": math.inf}}, "robot 'g1': default_pose: 'left_knee' is inf, expected a number"),
        ({"name": ""}, "robot: name is '', expected a text that is not empty"),
        ({"keypoints": ()}, r"robot 'g1': keypoints is \(\), expected"),
    ],
)
def test_fields_out_of_their_range_are_refused(changes, message):
    with pytest.raises(RobotError, match=message):
        replace(G1, **changes)


def test_a_keypoint_is_named_once():
    with pytest.raises(RobotError, match=f"robot 'g1': keypoints: '{G1.keypoints[3]}' stands there twice"):
        replace(G1, keypoints=(*G1.keypoints, G1.keypoints[3])).model()


def test_hands_are_told_by_their_side_in_the_order_of_any_list():
    left, right = G1.hands
    for hands in ((left, right), (right, left)):
        assert replace(G1, end_effectors=(*hands, *G1.feet)).hands == (left, right)
    assert replace(G1, end_effectors=(*G1.feet, left)).hands == ("", "")


def test_feet_in_the_wrong_order_are_refused(tmp_path):
    with pytest.raises(RobotError, match="sensor 'left_foot_contact' is of .* expected 'right_ankle.* left one of its"):
        replace(G1, feet=G1.feet[::-1]).check()
    (tmp_path / "robot.xml").write_text(re.sub("<sensor>.*</sensor>", "", G1.asset_path.read_text(), flags=re.DOTALL))
    message = "feet: 'right_ankle_roll_link' is to the right of 'left_ankle_roll_link' in the default pose"
    with pytest.raises(RobotError, match=message):
        replace(G1, asset=str(tmp_path / "robot.xml"), feet=G1.feet[::-1]).check()
