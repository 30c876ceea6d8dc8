"""Inputs of a run as fingerprints: motions, robot and other weights, so that a resumed run gets the same."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

import torch
from torch import nn

from plat.errors import ConfigError
from plat.motions.library import MotionLibrary
from plat.robots.mjcf import read_spec
from plat.robots.registry import get_robot
from plat.robots.robot import Robot
from plat.runs.json_object import read_json
from plat.runs.outputs import INPUTS_FILE
from plat.runs.recipe import RecipeConfig
from plat.words import counted

__all__ = [
    "changed_inputs",
    "check_drives",
    "motions_print",
    "robot_print",
    "run_inputs",
    "same_robot",
    "saved_inputs",
    "training_motions",
    "weights_print",
]

# Rounding differs by less from one processor to another, and a change of a motion is more.
_TOLERANCE = 5e-6
_CHUNK = 1 << 16
_LOOKED_AT = 1 << 22


def training_motions(recipe: RecipeConfig, dt: float) -> MotionLibrary:
    """Load the motions that a recipe trains on, for its robot and on its device.

    Args:
        recipe: settings, on a device.
        dt: control step (s).

    Raises:
        MotionError: for files that cannot be read.
    """
    robot = get_robot(recipe.robot)
    library = MotionLibrary.load(recipe.motions, robot, dt=dt, mirror=recipe.mirror, drop_bad=recipe.drop_bad)
    return library.to(recipe.device)


def run_inputs(library: MotionLibrary, **modules: nn.Module | None) -> dict[str, Any]:
    """Return the fingerprints of motions, their robot, and other runs' weights by name; None is left out.

    >>> from plat.motions import generate_motions
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> sorted(run_inputs(library, expert=nn.Linear(2, 1)))
    ['expert', 'motions', 'robot']
    """
    weights = {name: weights_print(module) for name, module in modules.items() if module is not None}
    return {"motions": motions_print(library), "robot": robot_print(library.robot), **weights}


def saved_inputs(folder: Path) -> dict[str, Any]:
    """Return the fingerprints in a run's folder, where the student of ``plat refine-model`` once was called ``init``.

    Raises:
        CheckpointError: when they cannot be read.
    """
    inputs = read_json(folder / INPUTS_FILE)
    return {"student": inputs["init"], **inputs} if "init" in inputs else inputs


def motions_print(library: MotionLibrary) -> list[list[Any]]:
    """Return name, frames and two figures of each clip, in their order.

    The figures are means over the frames: one of a weighted sum of root pose and joint angles, one that depends on the
    order of the frames as well. Of a library of more than 4 million frames (23 hours), a part is looked at, evenly.
    """
    start = library.clip_start.cpu()
    counted = torch.zeros(library.num_clips, dtype=torch.float64)
    sums = torch.zeros(library.num_clips, 2, dtype=torch.float64)
    for frames in torch.arange(0, len(library), 1 + len(library) // _LOOKED_AT).split(_CHUNK):
        clip = library.clip_of(frames.to(library.device)).cpu()
        time = frames - start[clip]
        pose = library.qpos(frames.to(library.device)).cpu().double()
        # unequal weights, none of them small
        value = pose @ (1 + 0.618 * torch.arange(pose.shape[1], dtype=torch.float64) % 1)
        sums.index_add_(0, clip, torch.stack((value, value * (0.37 * time).cos()), -1))
        counted.index_add_(0, clip, torch.ones_like(value))
    length = library.clip_length.cpu()
    figures = (sums / counted.clamp_min(1)[:, None]).tolist()
    return [
        [name, frames, *pair] for name, frames, pair in zip(library.clip_names, length.tolist(), figures, strict=True)
    ]


def robot_print(robot: Robot) -> str:
    """Return a hash of a robot's description and of its MJCF file with what that includes, wherever they lie."""
    fields = {name: value for name, value in dataclasses.asdict(robot).items() if name != "asset"}
    text = json.dumps(fields, sort_keys=True, default=str).encode()
    described = robot.asset_path.read_bytes()
    if b"<include" in described:
        described = read_spec(robot.asset, robot.name).to_xml().encode()
    return hashlib.blake2b(text + described, digest_size=16).hexdigest()


def same_robot(one: Robot, other: Robot) -> bool:
    """Return whether two robots differ in nothing but their names."""
    return one == other or robot_print(dataclasses.replace(one, name=other.name)) == robot_print(other)


def check_drives(policy: Robot, robot: Robot, flag: str) -> None:
    """Check that a policy's robot is the one that is simulated: for another one its actions mean other targets.

    Raises:
        ConfigError: naming both.
    """
    if not same_robot(policy, robot):
        raise ConfigError(f"{flag} drives robot {policy.name!r}, expected {robot.name!r}, that of --robot")


def weights_print(module: nn.Module) -> str:
    """Return a hash of a module's weights."""
    digest = hashlib.blake2b(digest_size=16)
    for name, tensor in module.state_dict().items():
        digest.update(name.encode())
        digest.update(tensor.detach().cpu().contiguous().view(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def changed_inputs(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Describe the inputs that differ; those that one side does not know are the same.

    >>> changed_inputs({"motions": [["walk", 9, 0.5, 0.1]]}, {"motions": [["run", 9, 0.5, 0.1]]})
    ["motions: clip 0 is 'run', was 'walk'"]
    """
    changes = []
    for name in sorted(set(before) & set(now)):
        if name == "motions":
            changes += [f"motions: {change}" for change in _changed_clips(before[name], now[name])][:1]
        elif before[name] != now[name]:
            changes.append(f"{name}: other content")
    return changes


def _changed_clips(before: Any, now: list[list[Any]]) -> list[str]:
    for number, (old, new) in enumerate(zip_longest(before, now)):
        if old is None or new is None:
            return [f"{counted(len(now), 'clip')}, were {len(before)}"]
        if old[0] != new[0]:
            return [f"clip {number} is {new[0]!r}, was {old[0]!r}"]
        if old[1] != new[1]:
            return [f"clip {number} {new[0]!r} has {new[1]} frames, had {old[1]}"]
        if any(abs(a - b) > _TOLERANCE * max(1.0, abs(a)) for a, b in zip(old[2:], new[2:], strict=True)):
            return [f"clip {number} {new[0]!r} has other content"]
    return []
