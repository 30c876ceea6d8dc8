"""Scores of anything that acts: a policy that only asks its motors for the keyframe's pose, beside PLAT.

python examples/score_anything.py
"""

from tensordict.nn import TensorDictModule

import plat
from plat.envs.transforms import HORIZONS
from plat.evaluation import compare, evaluate, report
from plat.motions import MotionLibrary
from plat.robots import G1

# a policy that asks its motors for the keyframe's pose, and lets balance be balance
pose = TensorDictModule(
    lambda joint_pos: (joint_pos - G1.default_joint_pos) / G1.action_scale, [("goal", "joint_pos")], ["action"]
)
motions = MotionLibrary.load(["generated:val@20"])
records = {
    name: evaluate(policy, motions, HORIZONS["mixed"])
    for name, policy in {"pose": pose, "PLAT": plat.load("plat-g1").deployed()}.items()
}
print(f"PLAT meets {report(records['PLAT'])['tks']:0.1f} % of the commands,")
print(f"which is {compare(records['PLAT'], records['pose'])['tks']:0.1f} more than the pose alone")
