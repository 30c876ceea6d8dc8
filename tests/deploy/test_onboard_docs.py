"""The programs of docs/onboard.md run, one after the other, with stand-ins for the robot."""

import re
from pathlib import Path

import numpy as np

from plat.keyframes import KeyframeSequence, standing
from plat.robots import G1
from tests.deploy.test_import import HEAVY
from tests.deploy.test_import import run as run_program

PAGE = (Path(__file__).parents[2] / "docs" / "onboard.md").read_text()


def test_the_programs_run(bundle, tmp_path):
    KeyframeSequence(G1, standing(G1), (standing(G1).at(0.1),)).save(tmp_path / "wave.json")
    (tmp_path / "bundle").symlink_to(bundle)
    program = f"""
import os
import numpy as np
from types import SimpleNamespace
os.chdir({str(tmp_path)!r})
joint_pos, joint_vel, torque = np.array({np.asarray(G1.default_joint_pos.tolist()).tolist()}), np.zeros(29), None
gyro, acceleration = np.zeros(3), np.array([0.0, 0.0, 9.81])
pose = SimpleNamespace(root_pos=np.array([1.0, 2.0, 0.76]), root_quat=np.array([1.0, 0, 0, 0]), joint_pos=joint_pos)
sequence = SimpleNamespace(start=pose)
keyframe, steps_left, tracked = pose, 10, np.array([1.0, 2.0, 0.76])
"""
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    program += "\n".join(blocks) + "\nprint('done')\n"
    result = run_program(program, HEAVY)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip().endswith("done")
