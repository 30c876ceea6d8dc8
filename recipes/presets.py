"""Named settings of the stages: ``--preset best`` (the default) and ``--preset paper``.

``BEST`` measured best and is the only home of the recipes' defaults. ``PAPER`` is the policy of the paper: no velocity
feed-forward, no motor gradient. Rewards and PPO's settings, which the paper does not give, stay as they are.
"""

from typing import Any

from plat.envs import KeyframeTaskConfig, TrackingTaskConfig
from plat.envs.transforms import DenseRewards, KeyframeRewards, TrackingTerm
from plat.modules import ExpertConfig, RefinementConfig
from plat.objectives import MotorGradientConfig, PPOConfig

__all__ = ["BEST", "PAPER", "PRESETS"]

BEST: dict[str, dict[str, Any]] = {
    "expert": {
        "policy": ExpertConfig(action="reference_velocity", ahead=(1, 2), lead=0.065, catch_up=1.0),
        "task": TrackingTaskConfig(dense=DenseRewards(anchor_pos=TrackingTerm(3.0, 0.4))),
    },
    "refine": {
        "policy": RefinementConfig(lead=0.05),
        # two thirds of the reward are for keyframes: the policy is not shown what is in between
        "task": KeyframeTaskConfig(
            dense_weight=0.3,
            sparse_weight=20.0,
            dense=DenseRewards(anchor_pos=TrackingTerm(2.0, 0.3)),
            sparse=KeyframeRewards(joint_pos=TrackingTerm(1.0, 0.1), keypoint_pos=TrackingTerm(1.0, 0.1)),
        ),
        # a motion ends with a keyframe, where rewards are highest: hence the mean value at truncation
        "ppo": PPOConfig(entropy=0.0, lr=1e-4, min_lr=2e-5, max_lr=3e-4, target_kl=0.005, truncated="mean"),
    },
}
PAPER: dict[str, dict[str, Any]] = {
    "expert": BEST["expert"] | {"policy": ExpertConfig(), "motor": MotorGradientConfig(weight=0)},
    "refine": BEST["refine"] | {"policy": RefinementConfig(), "motor": MotorGradientConfig(weight=0)},
}
PRESETS = {"best": BEST, "paper": PAPER}
