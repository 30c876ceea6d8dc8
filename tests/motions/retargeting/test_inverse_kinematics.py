import numpy as np
import pytest

from plat.motions.checks.steps import joint_steps
from plat.motions.clip import MotionClip
from plat.motions.retargeting import SolverOptions, builtin_maps, read_bvh
from plat.motions.retargeting.geometry import RobotGeometry
from plat.motions.retargeting.human import read_human
from plat.motions.retargeting.inverse_kinematics import solve
from plat.motions.retargeting.targets import Targets, robot_targets
from plat.robots import G1
from plat.rotations_np import axis_rotation

from .human import write_human

LAFAN1 = next(skeleton for skeleton in builtin_maps() if skeleton.name == "lafan1")


def targets_of(path) -> Targets:
    bvh = read_bvh(path)
    return robot_targets(read_human(bvh, LAFAN1, "a.bvh"), LAFAN1, RobotGeometry.of(G1), bvh.fps)


def test_joint_and_speed_limits_hold_whatever_the_targets_are(tmp_path):
    wild = {"LeftUpLeg": (200, 0, 0), "RightArm": (0, 300, 0), "LeftForeArm": (-90, 0, 0), "Spine": (-120, 80, 0)}
    targets = targets_of(write_human(tmp_path / "a.bvh", turns=wild, frames=20))
    joints = solve(targets, G1, 30.0, SolverOptions(max_joint_speed=6.0))[:, 7:]
    low, high = G1.joint_range.double().numpy().T
    assert (joints >= low - 1e-6).all()
    assert (joints <= high + 1e-6).all()
    speed = abs(np.diff(joints, axis=0)) * 30.0
    assert speed.max() == pytest.approx(6.0, abs=1e-6), "the limit is reached, and never passed"


def test_knees_and_elbows_bend_as_a_humans_do(tmp_path):
    turns = {"LeftUpLeg": (60, 0, 0), "LeftLeg": (-60, 0, 0), "RightForeArm": (60, 0, 0)}
    joints = solve(targets_of(write_human(tmp_path / "a.bvh", turns=turns)), G1, 30.0, SolverOptions())[:, 7:]
    knee, elbow = G1.joint_names.index("left_knee"), G1.joint_names.index("right_elbow")
    assert np.degrees(joints[15, knee] - joints[0, knee]) == pytest.approx(60, abs=10)
    # the robot's elbow is straight at about 90 degrees and bends toward negative angles
    assert np.degrees(joints[15, elbow] - joints[0, elbow]) == pytest.approx(-60, abs=10)


def test_joints_do_not_step_where_targets_do(tmp_path):
    targets = targets_of(write_human(tmp_path / "a.bvh", frames=40))
    turn = axis_rotation(0, np.array([0.25]))[0]
    for frame in range(20, 40):  # from one frame to the next the foot is elsewhere, and turned
        targets.rotations["left_ankle"][frame] = targets.rotations["left_ankle"][frame] @ turn
        targets.positions["left_ankle"][frame] += [0.05, 0.05, 0.05]
        targets.positions["left_knee"][frame] += [0.0, 0.2, 0.1]
    qpos = solve(targets, G1, 60.0, SolverOptions())
    assert joint_steps(MotionClip("a", qpos, 60.0)) == []
    assert np.abs(np.diff(qpos[:, 7:], axis=0)).max() * 60 <= 15.0 + 1e-6
    # and the joints are where they have to be, before and after
    alone = solve(replace_frames(targets, 20), G1, 60.0, SolverOptions())
    np.testing.assert_allclose(qpos[-1, 7:], alone[-1, 7:], atol=0.1)


def replace_frames(targets: Targets, first: int) -> Targets:
    """The targets from a frame on."""
    parts = {name: {role: array[first:] for role, array in part.items()} for name, part in vars(targets).items()}
    return Targets(**parts)
