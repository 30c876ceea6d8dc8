"""Records of every command of an evaluation. Their twin for one robot is :class:`plat.control.KeyframeScorer`."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from tensordict import TensorDictBase
from torch import Tensor

from plat.envs.transforms.command import CommandSchedule
from plat.envs.transforms.tracking_errors import beside_root, commanded_joints_and_bodies
from plat.errors import RecordsError
from plat.files import replace_file
from plat.json_file import parse_json
from plat.motions.library import MotionLibrary

__all__ = [
    "COMMANDED",
    "STEP_METRICS",
    "WINDOW_METRICS",
    "CommandRecorder",
    "CommandRecords",
    "join_columns",
    "read_columns",
    "write_columns",
]

WINDOW_METRICS = ("joint_error", "keypoint_error", "keypoint_error_root")
"""Errors that are averaged over a command's arrival window."""
STEP_METRICS = ("action_change", "joint_jerk", "foot_slip")
"""Quantities that are averaged over all steps."""
COMMANDED = {"joints": "joint_error", "bodies": "keypoint_error", "beside_root": "keypoint_error_root"}
"""What a command may command, with an error that it then has; ``beside_root`` are bodies other than the root."""


_Table = TypeVar("_Table")


def write_columns(path: Path, columns: Mapping[str, Tensor], about: Mapping[str, Any]) -> None:
    """Write a table of records and its description (JSON values) to a ``.safetensors`` file.

    Raises:
        RecordsError: when the disk does not take it.
    """
    try:
        replace_file(path, lambda part: save_file(dict(columns), part, {"about": json.dumps(dict(about))}))
    except SafetensorError as error:
        raise RecordsError(f"records {str(path)!r} could not be written ({error})") from error


def read_columns(path: Path, make: Callable[[Mapping[str, Tensor]], _Table]) -> tuple[_Table, dict[str, Any]]:
    """Return the table that ``make`` makes of a file's columns, and the file's description.

    Raises:
        RecordsError: when the file cannot be read or is another kind of file.
    """
    try:
        with safe_open(path, "pt") as file:
            columns = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
            about = parse_json(file.metadata()["about"].encode(), RecordsError, repr(str(path)), constants=True)
        if not isinstance(about, dict) or len({column.shape[:1] for column in columns.values()}) != 1:
            raise ValueError("no description, or columns of different lengths")
        return make(columns), about
    except RecordsError:
        raise
    except (OSError, RuntimeError, SafetensorError, LookupError, TypeError, ValueError) as error:
        told = str(error).strip().partition("\n")[0]
        raise RecordsError(f"{str(path)!r}: not a readable file of evaluation records ({told})") from error


def join_columns(parts: Sequence[Mapping[str, Tensor]]) -> dict[str, Tensor]:
    """Return columns whose rows are those of several tables, one after the other.

    Raises:
        RecordsError: for no tables, and a column that one of them lacks.
    """
    if not parts:
        raise RecordsError("no tables of records to join, expected at least one")
    if lacking := sorted({name for part in parts for name in part} - set(parts[0]).intersection(*parts)):
        raise RecordsError(f"tables of records to join: not all have the column {lacking[0]!r}, expected the same ones")
    return {name: torch.cat([part[name] for part in parts]) for name in parts[0]}


@dataclass
class CommandRecords:
    """One row for each of the M commands of a schedule.

    Attributes:
        clip: motion of each command ``[M]``.
        length: its control steps ``[M]``.
        steps: control steps that were taken for it ``[M]``.
        failed: terminated before it was fulfilled ``[M]``.
        fell: terminated with the root at the wrong height or tilt, or before its window by an absurd action or a
            simulation that diverged ``[M]``.
        window_steps: steps taken in its arrival window ``[M]``.
        window: for each of :data:`WINDOW_METRICS`, the mean over those steps ``[M]``; NaN where there were none.
        arrival_error: world keypoint error at the arrival step ``[M]`` (m); infinite for a command that failed.
        step: for each of :data:`STEP_METRICS`, the sum over all steps ``[M]``.
        commanded: for each of :data:`COMMANDED`, whether a command commands any ``[M]``. What is not given is read off
            the errors, as if all rows were of one kind.
        source: motion that the clip is a piece of ``[M]``; None where clips are whole motions.
        jerk_steps: those of ``steps`` at which there is a jerk ``[M]``: it takes three without a reset between them.
            What is not given is counted: robots are reset before a clip's first command, and after one that failed.
    """

    clip: Tensor
    length: Tensor
    steps: Tensor
    failed: Tensor
    fell: Tensor
    window_steps: Tensor
    window: dict[str, Tensor]
    arrival_error: Tensor
    step: dict[str, Tensor]
    commanded: dict[str, Tensor] = field(default_factory=dict)
    source: Tensor | None = None
    jerk_steps: Tensor | None = None

    def __post_init__(self) -> None:
        if self.jerk_steps is None:  # not in files of earlier versions
            self.jerk_steps = _jerk_steps(self.clip, self.failed, self.steps)
        reached = self.window_steps > 0
        for name in {"joints", "bodies"} - self.commanded.keys():
            measured = reached & ~self.window[COMMANDED[name]].isnan()
            all_or_none = bool(measured.any() | ~reached.any())
            self.commanded[name] = torch.full_like(reached, all_or_none)
        self.commanded.setdefault("beside_root", self.commanded["bodies"].clone())  # files share no memory

    def columns(self) -> dict[str, Tensor]:
        """Return every column by its name in files."""
        columns = {name: value for name, value in vars(self).items() if isinstance(value, Tensor)}
        for group in ("window", "step", "commanded"):
            columns |= {f"{group}.{name}": column for name, column in getattr(self, group).items()}
        return columns

    @classmethod
    def from_columns(cls, columns: Mapping[str, Tensor]) -> "CommandRecords":
        """Return the table of :meth:`columns`.

        Raises:
            KeyError, TypeError: when one is missing, or unknown.
        """
        rest = dict(columns)
        window = {name: rest.pop(f"window.{name}") for name in WINDOW_METRICS}
        step = {name: rest.pop(f"step.{name}") for name in STEP_METRICS}
        names = [name for name in COMMANDED if f"commanded.{name}" in rest]  # not in files of earlier versions
        commanded = {name: rest.pop(f"commanded.{name}") for name in names}
        return cls(**rest, window=window, step=step, commanded=commanded)

    def of_rows(self, rows: Tensor) -> "CommandRecords":
        """Return the rows that a mask ``[M]`` or indices choose."""
        return CommandRecords.from_columns({name: column[rows] for name, column in self.columns().items()})

    def of_clips(self, clips: Sequence[int]) -> "CommandRecords":
        """Return the rows of some motions."""
        return self.of_rows(torch.isin(self.clip, torch.tensor(clips)))

    @classmethod
    def joined(cls, parts: "Sequence[CommandRecords]") -> "CommandRecords":
        """Return the rows of several tables, one after the other.

        Raises:
            RecordsError: for no tables, and a column that one of them lacks, such as ``source``.
        """
        return cls.from_columns(join_columns([part.columns() for part in parts]))

    def save(self, path: Path, about: Mapping[str, Any]) -> None:
        """Write the table and a description of it (JSON values) to a ``.safetensors`` file."""
        write_columns(path, self.columns(), about)

    @classmethod
    def load(cls, path: Path) -> "tuple[CommandRecords, dict[str, Any]]":
        """Return the table of a file and its description.

        Raises:
            RecordsError: when the file cannot be read or is another kind of file.
        """
        return read_columns(path, cls.from_columns)


def _jerk_steps(clip: Tensor, failed: Tensor, steps: Tensor) -> Tensor:
    """Return how many steps of commands ``[M]``, in their order, have two before them since the robot was reset."""
    if not len(clip):
        return steps
    begins = torch.ones_like(failed, dtype=torch.bool)
    begins[1:] = failed[:-1].bool() | (clip[1:] != clip[:-1])
    before = steps.cumsum(0) - steps
    before = before - before[begins][begins.cumsum(0) - 1]
    return (before + steps - 2).clamp_min(0) - (before - 2).clamp_min(0)


class CommandRecorder:
    """Accumulator of :class:`CommandRecords`.

    Args:
        library: motions.
        schedule: the commands.
    """

    def __init__(self, library: MotionLibrary, schedule: CommandSchedule):
        self._library = library
        self._schedule = schedule
        count, device = schedule.num_commands, library.device

        def zeros() -> Tensor:
            return torch.zeros(count, dtype=torch.float64, device=device)

        self._steps, self._window_steps = zeros(), zeros()
        self._failed = torch.zeros(count, dtype=torch.bool, device=device)
        self._fell = torch.zeros_like(self._failed)
        self._window = {name: zeros() for name in WINDOW_METRICS}
        self._step = {name: zeros() for name in STEP_METRICS}
        self._arrival_error = torch.full((count,), torch.inf, dtype=torch.float64, device=device)

    def add(self, frame: Tensor, active: Tensor, after: TensorDictBase) -> None:
        """Add one step of all robots.

        Args:
            frame: library frames before the step ``[N]``.
            active: robots that are in the schedule ``[N]``.
            after: the environment's entries after the step: ``"metrics"``, ``"terminated"``, and of the command
                ``in_window`` and ``arrived``.
        """
        rows = self._schedule.command_of_frame[frame[active]]
        after = after[active]
        terminated = after["terminated"][:, 0]
        in_window = after["command", "in_window"][:, 0]
        arrived = after["command", "arrived"][:, 0] & ~terminated
        metrics = after["metrics"]
        self._steps.index_add_(0, rows, torch.ones_like(rows, dtype=torch.float64))
        self._failed[rows[terminated]] = True
        # before the window, only what is worse than a fall ends a command beside one: an absurd action, a simulation
        # that diverged. MuJoCo has put that robot up again
        self._fell[rows[terminated & ((metrics["fallen"][:, 0] > 0) | ~in_window)]] = True
        self._window_steps.index_add_(0, rows, in_window.double())
        for name, total in self._window.items():
            total.index_add_(0, rows, (metrics[name][:, 0] * in_window).double())
        for name, total in self._step.items():
            total.index_add_(0, rows, metrics[name][:, 0].double())
        self._arrival_error[rows[arrived]] = metrics["keypoint_error"][:, 0][arrived].double()

    def records(self) -> CommandRecords:
        """Return all records, on the CPU."""
        schedule, first = self._schedule, self._schedule.first_frame.to(self._library.device)
        return CommandRecords(
            clip=self._library.clip_of(first).cpu(),
            length=(schedule.target_frame[first] - first).cpu(),
            steps=self._steps.cpu(),
            failed=self._failed.cpu(),
            fell=self._fell.cpu(),
            window_steps=self._window_steps.cpu(),
            window={name: (total / self._window_steps).cpu() for name, total in self._window.items()},
            arrival_error=self._arrival_error.cpu(),
            step={name: total.cpu() for name, total in self._step.items()},
            commanded=self._commanded(),
        )

    def _commanded(self) -> dict[str, Tensor]:
        parts = self._schedule.parts
        if parts is None:
            every = torch.ones(self._schedule.num_commands, dtype=torch.bool)
            return {name: every.clone() for name in COMMANDED}
        joints, bodies = commanded_joints_and_bodies(parts, self._library.robot.num_joints)
        return {
            "joints": (joints > 0).any(-1).cpu(),
            "bodies": (bodies > 0).any(-1).cpu(),
            "beside_root": beside_root(bodies).cpu(),
        }
