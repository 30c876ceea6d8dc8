"""Made-up scores for figures."""

import math

import torch

from plat.evaluation import CommandRecords, Score


def records(failures: float, joint_error: float, keypoint_error: float, commands: int = 40) -> CommandRecords:
    """Commands of eight motions, of which the first share fails and all others have the same errors."""
    failed = torch.arange(commands) < failures * commands

    def column(value: float, of_failed: float = math.nan) -> torch.Tensor:
        return torch.where(failed, of_failed, value).double()

    errors = {"joint_error": joint_error, "keypoint_error": keypoint_error, "keypoint_error_root": keypoint_error / 2}
    return CommandRecords(
        clip=torch.arange(commands) % 8,
        length=torch.full((commands,), 20),
        steps=column(20, 10),
        failed=failed,
        fell=failed,
        window_steps=column(3, 0),
        window={name: column(error) for name, error in errors.items()},
        arrival_error=column(keypoint_error, math.inf),
        step={name: column(1, 1) for name in ("action_change", "joint_jerk", "foot_slip")},
    )


def made_up(*policies: str, horizons: tuple[str, ...] = ("short", "long", "mixed")) -> list[Score]:
    """Each policy better than the one before it, each horizon harder."""
    return [
        Score.of(policy, horizon, [records(0.1 * (number + 1) / rank, 0.1 * number / rank, 0.2 * number / rank)])
        for rank, policy in enumerate(policies, start=1)
        for number, horizon in enumerate(horizons, start=1)
    ]
