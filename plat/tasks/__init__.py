"""Tasks as functions of the robot's state, the same for simulated and for imagined robots."""

from plat.tasks.distances import smooth_angle, smooth_length

__all__ = ["smooth_angle", "smooth_length"]
