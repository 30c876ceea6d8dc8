"""From a trained policy to a bundle that :mod:`plat.deploy` runs without torch."""

from plat.export.robot import describe_robot

__all__ = ["describe_robot"]
