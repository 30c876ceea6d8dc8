"""plat: sparse timed keyframe control of humanoids, from composable TorchRL components."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("plat-rl")
except PackageNotFoundError:  # a source tree that was not installed
    __version__ = "0.0.0"

try:
    import gymnasium
except ModuleNotFoundError:  # a robot's computer that only runs plat.deploy
    pass
else:
    # strings, not classes: importing plat alone must not import torch
    gymnasium.register(
        id="plat/G1TimedKeyframe-v0",
        entry_point="plat.envs.gym:G1TimedKeyframeEnv",
        vector_entry_point="plat.envs.gym:G1TimedKeyframeVectorEnv",
    )
