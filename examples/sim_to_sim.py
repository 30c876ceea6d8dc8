"""Run a bundle in MuJoCo without torch: numpy, onnxruntime, mujoco, and of plat only plat.deploy and plat.keyframes.

python examples/sim_to_sim.py bundle            # a step to the side and back; or a file of keyframes: bundle wave.json

It ends where plat play does: imagined-g1 about 0.01 m from the last keyframe, plat-g1 0.02.
"""

import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from plat.deploy import PolicyRunner, RobotState
from plat.errors import PlatError
from plat.keyframes import KeyframeSequence, standing


def main(bundle: Path, keyframes: Path | None = None) -> float:
    """Return how far the robot is from the last keyframe at the end (m)."""
    runner = PolicyRunner(bundle)
    model = mujoco.MjModel.from_xml_path(str(bundle / "scene.xml"))
    data, substeps = mujoco.MjData(model), round(runner.robot.control_dt / model.opt.timestep)
    if keyframes is None:
        pose = standing(runner.robot)
        aside = replace(pose.at(1.0), root_pos=pose.root_pos + np.array([0.0, 0.3, 0.0]))
        sequence = KeyframeSequence(runner.robot, pose, (aside, pose.at(2.0)), runner.timing)
    else:
        sequence = KeyframeSequence.load(keyframes, runner.robot, timing=runner.timing)
    data.qpos[:] = sequence.start.qpos
    while (command := sequence.command(data.time)) is not None:
        to_root = np.empty(9)
        mujoco.mju_quat2Mat(to_root, data.qpos[3:7])
        joints = (data.qpos[7:].copy(), data.qvel[6:].copy())
        velocity = to_root.reshape(3, 3).T @ data.qvel[:3]
        state = RobotState(*joints, data.qpos[:3].copy(), data.qpos[3:7].copy(), velocity, data.qvel[3:6].copy())
        data.ctrl[:] = runner(state, command.keyframe, command.steps_left)
        mujoco.mj_step(model, data, substeps)
    return float(np.linalg.norm(data.qpos[:3] - sequence.keyframes[-1].root_pos))


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit("usage: python examples/sim_to_sim.py BUNDLE [KEYFRAMES]")
    try:
        print(f"{main(*map(Path, sys.argv[1:])):.3f} m from the last keyframe")
    except PlatError as error:
        sys.exit(f"error: {error}")
