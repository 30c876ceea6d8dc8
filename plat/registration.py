"""Tells gymnasium about plat's environments; an entry point, so that ``gymnasium.make`` finds them by itself."""

from gymnasium import register as _register

__all__ = ["register"]


def register() -> None:
    """Register ``plat/G1TimedKeyframe-v0``; gymnasium calls this when it is imported and adds the namespace."""
    # strings, not classes: importing gymnasium must not import torch
    _register(
        id="G1TimedKeyframe-v0",
        entry_point="plat.envs.gym:G1TimedKeyframeEnv",
        vector_entry_point="plat.envs.gym:G1TimedKeyframeVectorEnv",
    )
