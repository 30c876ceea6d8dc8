"""Another physics under an environment: one that knows how long its steps took.

python examples/timed_physics.py
"""

import time

from torch import Tensor

from plat.envs import BatchedPhysics, make_tracking_env
from plat.motions import MotionLibrary


class TimedPhysics(BatchedPhysics):
    """Physics that knows how long its steps took."""

    seconds = 0.0

    def step(self, ctrl: Tensor, nstep: int) -> None:
        began = time.perf_counter()
        super().step(ctrl, nstep)
        self.seconds += time.perf_counter() - began


env = make_tracking_env(MotionLibrary.load(["generated:val@20"]), num_envs=4, physics=TimedPhysics)
env.rollout(10, break_when_any_done=False)
print(f"{1000 * env.base_env.physics.seconds / 10:0.1f} ms a step")
