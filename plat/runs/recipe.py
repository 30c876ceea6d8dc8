"""Settings that all training recipes have in common."""

import errno
import logging
import os
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Protocol, TypeVar

from plat.bounds import Bounded, Count, Natural, NonNegative, NotEmpty, Positive, Robots, Seed
from plat.collectors.cluster import check_ray
from plat.envs.settings import PhysicsName, check_physics
from plat.errors import ConfigError, PlatError
from plat.files import check_folder
from plat.runs.budget import Budget
from plat.runs.loggers import LoggerName, check_logger, chosen_loggers
from plat.runs.outputs import check_out
from plat.runs.user_modules import Imports, import_modules
from plat.streams import standard_streams

__all__ = ["RecipeConfig", "begin", "default_device", "on_device", "report_errors"]


class _HasDevice(Protocol):
    device: str


# what a machine lacks is told without the name of a file; the last is of temporary folders
_MACHINE = {
    getattr(errno, name, None) for name in ("EDQUOT", "EIO", "EMFILE", "ENFILE", "ENOMEM", "ENOSPC", "ENOENT")
} - {None}
# by PyTorch on CPUs and GPUs, and by MuJoCo
_OUT_OF_MEMORY = re.compile("can't allocate memory|out of memory|[Cc]ould not allocate|bad_alloc")
_LONGEST = 200

R = TypeVar("R", bound=_HasDevice)
T = TypeVar("T", bound="RecipeConfig")


def default_device() -> str:
    """Return ``"cuda"`` where it is available, else ``"cpu"``."""
    import torch  # not at the top: help texts show the settings below without it

    return "cuda" if torch.cuda.is_available() else "cpu"


def on_device(settings: R) -> R:
    """Return settings whose ``device`` is one: what :func:`default_device` says in the place of ``"auto"``.

    Raises:
        ConfigError: for a device that this machine does not have.
    """
    if settings.device == "auto":
        return replace(settings, device=default_device())  # type: ignore[type-var]
    from plat.gpu import check_device  # torch, as above

    check_device(settings.device, "--device")
    return settings


def begin(recipe: T) -> T:
    """Return the settings of a recipe on its device, after a check of all that does not need its motions.

    Raises:
        PlatError: for a module, device, robot, physics, Ray or logger that is not there, no budget, a folder that
            cannot be written to, one that holds a run already, or one that holds none to resume.
    """
    from plat.robots import get_robot  # torch, as above

    recipe = on_device(recipe)
    import_modules(recipe.imports)
    get_robot(recipe.robot)  # a description file makes the robot of the runs that it goes on from known
    Budget(recipe.minutes, recipe.steps)
    check_physics(recipe.physics)
    if recipe.ray:
        check_ray()
    for logger in recipe.loggers:
        check_logger(logger)
    check_folder(recipe.out)
    check_out(recipe.out, resume=recipe.resume)
    return recipe


@dataclass(kw_only=True)
class RecipeConfig(Bounded):
    """Base settings of a recipe: training data, budget and output.

    Attributes:
        name: of the stage; ``config.json`` and the command line call it so.
        presets: by name, values of fields that ``--preset`` starts from.
    """

    name: ClassVar[str]
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}

    motions: Annotated[tuple[str, ...], NotEmpty()]
    """motion files, folders or globs; "generated:train@600" for 10 minutes of generated motion"""
    mirror: bool = False
    """train on the mirror image of every motion as well"""
    drop_bad: bool = False
    """leave out motions of files that plat motions inspect would drop"""
    out: Path
    """folder to write the run to"""
    minutes: Positive | None = None
    """stop after this many minutes of training"""
    steps: Count | None = None
    """stop after this many environment steps, all robots together"""
    resume: bool = False
    """resume from the last checkpoint in OUT"""
    seed: Seed = 0
    """seeds everything that is drawn"""
    device: str = "auto"
    """device of networks and tensors; by default "cuda" where there is one"""
    robot: str = "g1"
    """name of the robot, or path of its JSON description"""
    num_envs: Robots = 512
    """robots simulated at a time"""
    physics: PhysicsName = "mujoco"
    """MuJoCo on the CPU, or "warp": MuJoCo Warp on the device (extra: warp)"""
    workers: Natural = 0
    """processes that simulate them, each on a share of the CPUs; 0: in the learning process"""
    ray: bool = False
    """start them on a Ray cluster, the one at RAY_ADDRESS or of this machine (extra: ray)"""
    wandb: bool = False
    """log to Weights & Biases; offline unless you are logged in"""
    trackio: bool = False
    """log to trackio, which keeps its files on this machine"""
    video_every: NonNegative = 900.0
    """seconds between logged videos of the policy on the first motion; 0 for none"""
    save_every: NonNegative = 120.0
    """seconds between checkpoints"""
    imports: Imports = ()
    """module that registers custom policy classes"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.workers > self.num_envs:
            raise ConfigError(
                f"{type(self).__name__}: workers is {self.workers}, expected at most num_envs, {self.num_envs}"
            )
        if self.ray and not self.workers:
            raise ConfigError(f"{type(self).__name__}: ray is for workers, expected workers to be at least 1")
        if not (self.resume or self.loggers) and self.video_every not in (0, type(self).video_every):
            what = f"{type(self).__name__}: video_every is {self.video_every:g}, and nothing logs videos"
            raise ConfigError(f"{what}: expected wandb or trackio beside it")
        if self.workers and self.physics == "warp":
            what = f"{type(self).__name__}: physics is 'warp', which is on one device"
            raise ConfigError(f"{what}: expected workers to be 0")

    def as_written_now(self, saved: Mapping[str, Any]) -> dict[str, Any]:
        """Return the settings of a run as this version of plat would have written them.

        Args:
            saved: those of the ``config.json`` of a run of the same recipe.
        """
        return dict(saved)

    @property
    def loggers(self) -> tuple[LoggerName, ...]:
        """Return the experiment loggers that were asked for."""
        return chosen_loggers(self.wandb, self.trackio)


@contextmanager
def report_errors() -> Iterator[None]:
    """Exit with one line on plat's own errors, those of files and where memory runs out, without a traceback.

    TorchRL's context of an error is left out, Ctrl-C ends with one line, and the standard streams are those of
    :func:`~plat.streams.standard_streams`: a reader that leaves, as ``head`` does, ends the program quietly.
    Assumptions that plat makes about motion files are printed.
    """
    os.environ.setdefault("RL_LOGGING_LEVEL", "WARNING")  # TorchRL sets its level when it is imported
    logging.getLogger("torchrl").setLevel(logging.WARNING)
    motions = logging.getLogger("plat.motions")
    motions.setLevel(logging.INFO)
    if not motions.handlers:
        motions.addHandler(logging.StreamHandler(sys.stdout))
    with standard_streams():
        try:
            yield
        except PlatError as error:
            sys.exit(f"error: {error}")
        except OSError as error:
            if error.filename is None and error.errno not in _MACHINE:
                raise
            sys.exit(f"error: {'' if error.filename is None else f'{str(error.filename)!r}: '}{error.strerror}")
        except (MemoryError, RuntimeError) as error:
            told = str(error).strip().partition("\n")[0]
            if not isinstance(error, MemoryError) and not _OUT_OF_MEMORY.search(told):
                raise
            sys.exit(
                f"error: not enough memory{f' ({told[:_LONGEST]})' if told else ''}: take fewer --num-envs, --workers "
                "or motions, where the command has them"
            )
        except KeyboardInterrupt:
            print("stopped", file=sys.stderr)
            sys.exit(130)
