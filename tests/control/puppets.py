"""Controllers that need no policy."""

import numpy as np

from plat.robots import G1
from plat.spec.timing import Timing

DEFAULT = G1.default_joint_pos.double().numpy()


class Puppet:
    """Tells the motors the joint angles of the keyframe; remembers what it was asked."""

    def __init__(self, timing=Timing()):
        self.timing = timing
        self.asked = []
        self.resets = []

    def reset(self, joint_target=None):
        self.resets.append(joint_target)

    def __call__(self, state, keyframe, steps_left):
        self.asked.append((keyframe, steps_left))
        return np.asarray(keyframe.joint_pos)


class Limp(Puppet):
    """Lets the robot fall: the motors are told to stay where they are."""

    def __call__(self, state, keyframe, steps_left):
        return state.joint_pos


class Kicking(Puppet):
    """Tells the motors after some steps what no simulation stands."""

    def __init__(self, steps):
        super().__init__()
        self.steps = steps

    def reset(self, joint_target=None):
        self.asked.clear()

    def __call__(self, state, keyframe, steps_left):
        target = super().__call__(state, keyframe, steps_left)
        return target if len(self.asked) <= self.steps else target + 1e12
