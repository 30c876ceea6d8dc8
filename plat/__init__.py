"""plat: sparse timed keyframe control of humanoids, from composable TorchRL components."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("plat-rl")
except PackageNotFoundError:  # a source tree that was not installed
    __version__ = "0.0.0"
