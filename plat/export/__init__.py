"""Export of a trained policy as a bundle that :mod:`plat.deploy` runs without torch."""

from plat.export.bundle import ExportCheck, export_bundle
from plat.export.network import JointTargetNetwork
from plat.export.push import push_run
from plat.robots.describe import describe_robot

__all__ = ["ExportCheck", "JointTargetNetwork", "describe_robot", "export_bundle", "push_run"]
