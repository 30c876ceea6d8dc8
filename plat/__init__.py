"""plat: sparse timed keyframe control of humanoids, from composable TorchRL components."""

from typing import TYPE_CHECKING

from plat.moved import install

if TYPE_CHECKING:
    from plat.runs import Policy
from plat.version import __version__ as __version__

install()

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


def load(name: str, device: str = "cpu") -> "Policy":
    """A trained policy that comes with plat, as :func:`plat.runs.load_policy` loads one of your own.

    Args:
        name: ``"plat-g1"``, ``"dagger-g1"``, ``"expert-g1"``, or ``"plat-generated-g1"``, trained on plat's own motions
            alone; see ``weights/README.md`` for their data, licence and scores.
        device: where its weights go.

    Raises:
        CheckpointError: for another name, listing those that there are.

    >>> load("plat-g1").deployed().out_keys
    ['action']
    """
    from plat.runs.shipped import load_shipped  # torch: importing plat alone must not import it

    return load_shipped(name, device)
