"""The command line: ``plat COMMAND``.

Every command has a dataclass of its settings (or a union of them), and a module whose ``main`` is given one. The
settings stand in ``options``, and the module is imported when its command runs: help texts need no torch.
"""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from plat.streams import standard_streams
from plat.words import no_command

__all__ = ["COMMANDS", "Subcommand", "main"]


@dataclass(frozen=True)
class Subcommand:
    """Subcommand of ``plat``.

    Attributes:
        module: whose ``main`` runs it.
        settings: name of its settings in ``options`` beside that module.
        summary: what it does, in one line.
    """

    module: str
    settings: str
    summary: str

    def kind(self) -> Any:
        """Return the dataclass of the settings, or a union of several."""
        package, _, _ = self.module.rpartition(".")
        _check_link(Path(__file__).parents[1] / package.rpartition(".")[2])
        return getattr(import_module(f"{package}.options"), self.settings)


COMMANDS = {
    "expert": Subcommand(
        "plat.recipes.expert",
        "ExpertRecipe",
        "stage 1: train a dense motion-tracking expert with PPO",
    ),
    "expert-model": Subcommand(
        "plat.recipes.expert_model",
        "ExpertModelRecipe",
        "stage 1 by imagination: in a learned model of the robot",
    ),
    "imagine": Subcommand(
        "plat.recipes.imagine",
        "ImagineRecipe",
        "a keyframe policy by imagination, without an expert",
    ),
    "distill": Subcommand(
        "plat.recipes.distill",
        "DistillRecipe",
        "stage 2: teach a student that sees only keyframes, by DAgger",
    ),
    "refine": Subcommand(
        "plat.recipes.refine",
        "RefineRecipe",
        "stage 3: refine the student with PPO on a residual in its latent",
    ),
    "refine-model": Subcommand(
        "plat.recipes.refine_model",
        "RefineModelRecipe",
        "stage 3 by imagination: in a learned model of the robot",
    ),
    "ablations": Subcommand(
        "plat.recipes.ablations",
        "AblationsRecipe",
        "train and score every row of the paper's ablation",
    ),
    "demo": Subcommand(
        "plat.recipes.demo",
        "DemoRecipe",
        "all three stages and the evaluation, small, in a few minutes",
    ),
    "evaluate": Subcommand("plat.cli.evaluate", "EvaluateRecipe", "score policies on motions: timed keyframe tracking"),
    "benchmark": Subcommand(
        "plat.cli.benchmark",
        "BenchmarkRecipe",
        "score policies and released trackers on public motions, in one table",
    ),
    "baselines": Subcommand(
        "plat.cli.baselines",
        "BaselinesRecipe",
        "list released trackers: owner, version, hash, license, how to get them",
    ),
    "play": Subcommand("plat.cli.play", "PlayRecipe", "let a policy chase the keyframes of a file"),
    "studio": Subcommand(
        "plat.cli.studio",
        "StudioRecipe",
        "pose keyframes in the browser and watch policies chase them",
    ),
    "motions": Subcommand("plat.cli.motions", "MotionsCommand", "inspect, convert, mirror and retarget motion files"),
    "keyframes": Subcommand(
        "plat.cli.keyframes",
        "KeyframesCommand",
        "make keyframe files out of motions, and look at them",
    ),
    "export": Subcommand(
        "plat.cli.export",
        "ExportRecipe",
        "write a policy as an ONNX bundle for robots and other simulators",
    ),
    "sim-to-sim": Subcommand(
        "plat.cli.sim_to_sim",
        "SimToSimRecipe",
        "score a bundle in MuJoCo at other physics than in training",
    ),
    "average": Subcommand(
        "plat.cli.average", "AverageRecipe", "average the weights of runs that came from one another"
    ),
    "curves": Subcommand("plat.cli.curves", "CurvesRecipe", "draw the learning curves of runs"),
}


def main(args: Sequence[str] | None = None) -> None:
    """Run a command; user errors end the program with one line.

    Args:
        args: the command line, by default the program's own.

    >>> main(["--help"])
    usage: plat COMMAND ...
    ...
    """
    words = list(sys.argv[1:] if args is None else args)
    try:
        with standard_streams():
            _run(words or ["--help"])
    except (KeyboardInterrupt, ImportError) as error:  # while a help text is made or a command is imported
        if not _is_interrupt(error):
            raise
        print("stopped", file=sys.stderr)
        sys.exit(130)


def _is_interrupt(error: BaseException | None) -> bool:
    """Return whether Ctrl-C is behind an error: extension modules make a failed import of it."""
    while isinstance(error, ImportError):
        error = error.__cause__
    return isinstance(error, KeyboardInterrupt)


def _run(words: Sequence[str]) -> None:
    name, *rest = words
    if name in ("-h", "--help"):
        print(_usage())
        return
    if name == "--version":
        from plat.version import __version__

        print(f"plat {__version__}")
        return
    if name not in COMMANDS:
        sys.exit(f"error: {no_command(name, 'plat', COMMANDS)}")
    try:
        os.getcwd()
    except FileNotFoundError:
        sys.exit("error: the current folder does not exist any more: go to another one")
    from plat.cli.settings import run

    command = COMMANDS[name]
    run(command.module, command.kind(), rest, prog=f"plat {name}")


def _check_link(package: Path) -> None:
    """End the program where a clone has a file in the place of a link to a package, as on Windows without them."""
    if package.is_file():
        sys.exit(
            f"error: {str(package)!r} is a file, expected a link to a folder: clone plat again with "
            "`git clone -c core.symlinks=true`, on Windows in its developer mode"
        )


def _usage() -> str:
    rows = [f"  {name:<14}{command.summary}" for name, command in COMMANDS.items()]
    return "\n".join(["usage: plat COMMAND ...", "", *rows, "", "plat COMMAND --help explains its settings."])
