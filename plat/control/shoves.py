"""Pushes of the robot at regular intervals, in random horizontal directions."""

import numpy as np

from plat.bounds import NonNegative, Positive, check_value
from plat.control.simulator import Simulator

__all__ = ["Shoves"]


class Shoves:
    """Shoves a robot every now and then.

    Args:
        speed: change of velocity (m/s).
        every: seconds in between.
        seed: draws the directions, uniform in the horizontal plane.
        control_dt: seconds of a control step.
    """

    def __init__(self, speed: float, every: float, seed: int, control_dt: float):
        check_value("push: speed", speed, NonNegative)
        check_value("push: seconds in between", every, Positive)
        self._speed, self._steps, self._dt = speed, max(1, round(every / control_dt)), control_dt
        self._random = np.random.default_rng(seed)
        self._count = 0

    def after_step(self, simulator: Simulator) -> None:
        """Count a control step, and shove if it is time."""
        self._count += 1
        if self._speed and self._count % self._steps == 0:
            angle = self._random.uniform(-np.pi, np.pi)
            simulator.push(self._speed * np.array([np.cos(angle), np.sin(angle), 0.0]))
            towards = f"{np.degrees(angle):.0f} degrees from the world's x"
            print(f"shove of {self._speed:g} m/s at {self._count * self._dt:.2f} s, {towards}")
