"""Dense tracking score: the fraction of each motion that a tracker follows from its first frame."""

from itertools import islice

import torch
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import Compose, InitTracker, TransformedEnv

from plat.baselines.tracker_reference import TrackerReference
from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms import FirstFrames, ReferenceMotion, TrackingLimits, TrackingTermination
from plat.evaluation.rollout import policy_steps
from plat.evaluation.setting import Observe
from plat.motions.library import MotionLibrary

__all__ = ["follow"]


def follow(
    policy: TensorDictModuleBase,
    library: MotionLibrary,
    *,
    ahead: int = 1,
    observe: Observe | None = None,
    limits: TrackingLimits | None = None,
    num_threads: int | None = None,
) -> Tensor:
    """Return the fraction of every motion that a policy tracks when given the dense reference.

    Every robot starts on the first frame of its motion, without noise or randomization. Terminations are those of dense
    tracking.

    Args:
        policy: reads ``"robot"``, ``"tracker_reference"`` and ``is_init``, writes ``action``.
        library: motions of the robot that the policy drives.
        ahead: frame of the reference in the observation, counted from the current one.
        observe: makes the transforms that show the reference, in place of ``"tracker_reference"``; an expert of
            plat needs those of its :class:`plat.evaluation.ReferenceView`.
        limits: termination limits.
        num_threads: threads of the physics pool.

    Returns:
        Fraction ``[C]`` of each clip's frames before termination; 1 for a clip that was tracked to its end.
    """
    count = library.num_clips
    views = [TrackerReference(library, ahead=ahead)] if observe is None else observe(library, True)
    env = TransformedEnv(
        MotionTrackingEnv(library, count, num_threads=num_threads),
        Compose(
            ReferenceMotion(library),
            TrackingTermination(library.robot, limits),
            FirstFrames(library),
            *views,
            InitTracker(),
        ),
    )
    fraction = torch.full((count,), torch.nan)
    for number, step in enumerate(islice(policy_steps(policy, env), int(library.clip_length.max()) - 1), 1):
        ended = step["next", "done"][:, 0] & fraction.isnan()  # later ends are of a second episode
        lost = step["next", "terminated"][:, 0]
        reached = torch.where(lost, number / library.clip_length, 1.0)
        fraction = torch.where(ended, reached, fraction)
    env.close()
    return fraction
