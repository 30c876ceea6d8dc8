"""plat: sparse timed keyframe control of humanoids, from composable TorchRL components."""

from typing import TYPE_CHECKING

from plat import headless  # noqa: F401 - before MuJoCo, which most of plat's packages import
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
    """Load a trained policy that comes with plat or is on the Hugging Face Hub.

    :func:`plat.runs.load_policy` loads one of your own.

    Args:
        name: ``"plat-g1"``, ``"finetuned-g1"``, ``"dagger-g1"``, ``"expert-g1"``, ``"expert-model-g1"``,
            ``"imagined-g1"``, ``"imagined-latent-g1"``, ``"imagined-robot-g1"``, which is for robots, or
            ``"imagined-free-g1"`` and ``"plat-generated-g1"``, which are under plat's license; or ``"hf:owner/name"``,
            a run on the Hugging Face Hub (extra ``plat-rl[hub]``). Data, license and scores are in
            ``plat/weights/README.md``.
        device: of the weights.

    Raises:
        CheckpointError: for another name, with the list of names, and for a run that cannot be downloaded.
        ConfigError: for a device that this machine does not have.

    >>> load("plat-g1").deployed().out_keys
    ['action']
    """
    from plat.runs.shipped import load_shipped  # torch: importing plat alone must not import it

    return load_shipped(name, device)
