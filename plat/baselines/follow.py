"""Does a tracker follow motions from the first frame to the last?"""

import torch
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import Compose, InitTracker, TransformedEnv

from plat.baselines.reference import TrackerReference
from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms import FirstFrames, ReferenceMotion, TrackingLimits, TrackingTermination
from plat.motions.library import MotionLibrary

__all__ = ["follow"]


@torch.no_grad()
def follow(
    policy: TensorDictModuleBase,
    library: MotionLibrary,
    *,
    ahead: int = 1,
    limits: TrackingLimits | None = None,
    num_threads: int | None = None,
) -> Tensor:
    """How long a policy stays on every motion of a library when it is shown the dense reference.

    Every robot starts on the first frame of its motion; no noise, no randomisation; the terminations of dense
    tracking.

    Args:
        policy: reads ``"robot"``, ``"tracker_reference"`` and ``is_init``, writes ``action``.
        library: motions of the robot that the policy drives.
        ahead: which frame it is shown, counted from the current one.
        limits: when it has lost the motion.
        num_threads: threads of the physics pool.

    Returns:
        Share ``[C]`` of each clip's frames until it was lost; 1 for a clip that was followed to the end.
    """
    count = library.num_clips
    env = TransformedEnv(
        MotionTrackingEnv(library, count, num_threads=num_threads),
        Compose(
            ReferenceMotion(library),
            TrackingTermination(library.robot, limits),
            FirstFrames(library),
            TrackerReference(library, ahead=ahead),
            InitTracker(),
        ),
    )
    share = torch.full((count,), torch.nan)
    tensordict = env.reset()
    for step in range(1, int(library.clip_length.max())):
        tensordict, following = env.step_and_maybe_reset(policy(tensordict))
        ended = tensordict["next", "done"][:, 0] & share.isnan()  # later ends are of a second run
        lost = tensordict["next", "terminated"][:, 0]
        reached = torch.where(lost, step / library.clip_length, 1.0)
        share = torch.where(ended, reached, share)
        tensordict = following
    env.close()
    return share
