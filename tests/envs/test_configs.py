"""Every setting of a task changes what happens in it."""

import dataclasses
from collections.abc import Iterable, Iterator
from typing import Any

import pytest
import torch

from plat.envs import (
    DistillationTaskConfig,
    KeyframeTaskConfig,
    TrackingTaskConfig,
    make_keyframe_env,
    make_tracking_env,
)
from plat.envs.transforms import NoiseLevels, RandomizationRanges, Regularization
from plat.motions import MotionLibrary

PENALTIES = Regularization(torque=-0.01, foot_slip=-0.1, impact=-0.1)
RANGES = RandomizationRanges(
    push_interval=(0.1, 0.2),
    longer_delay=0.5,
    torso_mass=1.0,
    gyro_bias=0.05,
    velocity_bias=0.1,
    position_drift=0.1,
    heading_drift=0.1,
    height_error=0.05,
)
SIMULATION = {"noise": NoiseLevels(), "randomization": RANGES}
CONFIGS = {
    "tracking": TrackingTaskConfig(regularization=PENALTIES, **SIMULATION),
    "distillation": DistillationTaskConfig(),
    "keyframe": KeyframeTaskConfig(regularization=PENALTIES),
}


def leaves(config: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Paths to the fields that are no dataclasses themselves."""
    for field in dataclasses.fields(config):
        value, here = getattr(config, field.name), (*path, field.name)
        if dataclasses.is_dataclass(value):
            yield from leaves(value, here)
        else:
            yield here


def changed(value: Any) -> Any:
    """Another value of a field, far from its own."""
    if isinstance(value, tuple):
        return tuple(map(changed, value))
    if isinstance(value, str):
        return {"spheres": "capsules"}[value]
    return value // 2 if isinstance(value, int) and value > 1 else 0.02 * value


def replaced(config: Any, path: tuple[str, ...]) -> Any:
    value = getattr(config, path[0])
    new = replaced(value, path[1:]) if len(path) > 1 else changed(value)
    return dataclasses.replace(config, **{path[0]: new})


def outcome(config: Any, library: MotionLibrary, steps: int) -> Iterator[torch.Tensor]:
    """All that is observed and paid in a rollout, step by step."""
    torch.manual_seed(0)
    make = make_tracking_env if isinstance(config, TrackingTaskConfig) else make_keyframe_env
    env = make(library, 4, config, num_threads=1)
    before = env.reset()
    for _ in range(steps):
        step, before = env.step_and_maybe_reset(before.set("action", 0.7 * torch.randn(4, 29)))
        entries = step["next"].select("reward", "done", "robot", "goal").values(True, True)
        yield torch.cat([entry.flatten().float() for entry in entries])


def same(first: Iterable[torch.Tensor], second: Iterable[torch.Tensor]) -> bool:
    """Whether all steps are; those after the first that is not are not simulated."""
    return all(torch.equal(one, other) for one, other in zip(first, second, strict=True))


# settings that all tasks share are tried in one of them
CASES = [("tracking", path) for path in leaves(CONFIGS["tracking"])]
CASES += [("distillation", path) for path in leaves(CONFIGS["distillation"]) if path[0] == "limits"]
CASES += [
    ("keyframe", path)
    for path in leaves(CONFIGS["keyframe"])
    if path[0] in ("dense", "sparse", "regularization") or path[0].endswith("_weight")
]


@pytest.fixture(scope="module")
def outcomes() -> dict[tuple[str, int], list[torch.Tensor]]:
    return {}


@pytest.mark.parametrize(("task", "path"), CASES, ids=lambda part: part if isinstance(part, str) else ".".join(part))
def test_a_setting_has_an_effect(library, outcomes, task, path):
    # where failures are is counted up every 50th step, and hard impacts are rare; a keyframe arrives after some steps
    steps = 120 if path[-1] in ("uniform_starts", "impact") else 12 if task == "tracking" else 25
    if (task, steps) not in outcomes:
        outcomes[task, steps] = list(outcome(CONFIGS[task], library, steps))
    assert not same(outcomes[task, steps], outcome(replaced(CONFIGS[task], path), library, steps))


def test_one_seed_is_one_outcome(library):
    # or the test above would prove nothing
    for config in CONFIGS.values():
        assert same(list(outcome(config, library, 25)), outcome(config, library, 25))
