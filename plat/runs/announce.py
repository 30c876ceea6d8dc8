"""Lines on the screen when a training begins, and the command that comes next."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import torch

from plat.envs.physics.mujoco_batch import available_cpus
from plat.precision import Precision, has_fast_bfloat16
from plat.words import counted

if TYPE_CHECKING:
    from plat.motions.library import MotionLibrary
    from plat.runs.recipe import RecipeConfig

__all__ = ["begins", "next_command"]

_FILES = ("model.safetensors", "metrics.csv", "config.json")


def begins(recipe: "RecipeConfig", library: "MotionLibrary", precision: Precision, good: str) -> None:
    """Print what is trained on what, with what, for how long and where to.

    Args:
        recipe: settings, on a device.
        library: motions.
        precision: of the networks.
        good: which figures on the lines to come are good.
    """
    half = precision == "bfloat16" or (precision == "auto" and has_fast_bfloat16(recipe.device))
    limits = [
        *([counted(recipe.minutes, "minute")] if recipe.minutes is not None else []),
        *([counted(recipe.steps, "step")] if recipe.steps is not None else []),
    ]
    workers = f", in {counted(recipe.workers, 'worker')}{' on Ray' * recipe.ray}" if recipe.workers else ""
    print(
        f"{recipe.name}: {counted(library.num_clips, 'clip')}, {library.duration:.0f} s; "
        f"{counted(recipe.num_envs, 'robot')} on {counted(available_cpus(), 'CPU')}"
        f"{workers}; networks on {recipe.device}, "
        f"{counted(torch.get_num_threads(), 'thread')}, {'bfloat16' if half else 'float32'}; "
        f"for {' or '.join(limits)}\n"
        f"into {recipe.out}, a checkpoint every {recipe.save_every:g} s; good: {good}",
        flush=True,
    )


class _Settings(Protocol):
    out: Path
    robot: str
    imports: tuple[str, ...]


def next_command(settings: _Settings, *words: str | Path | Sequence[str]) -> str:
    """Return the lines that say where a run is, with those of its files that are there, and which command comes next.

    Args:
        settings: of the command that made the run: its folder, and the robot and the modules of the user's that the
            next one needs as well.
        words: of the next command.

    >>> from plat.cli.options import AverageRecipe
    >>> made = AverageRecipe(runs=(Path("a"), Path("b")), out=Path("runs/a b"), robot="toy.json", imports=("mine",))
    >>> print(next_command(made, "plat evaluate", made.out, "--motions", ("x.npz", "*.csv")))
    the run is in runs/a b
    next: plat evaluate 'runs/a b' --motions x.npz '*.csv' --robot toy.json --import mine
    """
    flat = [part for word in words for part in ([word] if isinstance(word, str | Path) else word)]
    if settings.robot != "g1":
        flat += ["--robot", settings.robot]
    for name in settings.imports:
        flat += ["--import", name]
    first, *rest = flat
    command = " ".join([str(first), *(shlex.quote(str(word)) for word in rest)])
    files = ", ".join(name for name in _FILES if (settings.out / name).exists())
    return f"the run is in {settings.out}{': ' if files else ''}{files}\nnext: {command}"
