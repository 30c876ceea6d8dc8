"""Sparse timed keyframe commands: one future pose and the time to its arrival."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.data import Composite, Unbounded
from torchrl.envs import Transform

from plat.bounds import Count, Fraction, Natural, Seed, check_value, shown
from plat.envs.goals import clock_entries, parts_entries, robot_centric_goal
from plat.envs.part_masks import NUM_MASKS, draw_parts
from plat.envs.transforms.base import ObservationTransform
from plat.errors import MotionError, TaskError
from plat.motions.library import MotionLibrary
from plat.robots.robot import Robot
from plat.spec.observation import as_observed, entry_shapes
from plat.spec.timing import Timing
from plat.words import counted

__all__ = [
    "HORIZONS",
    "PAPER_HORIZONS",
    "CommandSchedule",
    "Horizon",
    "KeyframeClock",
    "KeyframeCommand",
    "check_timing",
    "horizon_named",
]


@dataclass(frozen=True)
class Horizon:
    """Range of command lengths in control steps, both ends included."""

    shortest: int
    longest: int

    def __post_init__(self) -> None:
        if not (isinstance(self.shortest, int) and isinstance(self.longest, int)):
            raise TaskError(f"horizon: {self.shortest!r} to {self.longest!r}, expected whole numbers of control steps")
        if not 1 <= self.shortest <= self.longest:
            raise TaskError(f"horizon: {self.shortest} to {self.longest} steps, expected 1 <= shortest <= longest")


PAPER_HORIZONS = {
    "single": Horizon(1, 1),
    "short": Horizon(2, 10),
    "medium": Horizon(11, 25),
    "long": Horizon(26, 50),
    "mixed": Horizon(1, 50),
}
"""The paper's horizon settings, whatever the timing of a policy."""

HORIZONS = {**PAPER_HORIZONS, "distant": Horizon(51, 150)}
"""All horizon settings by name; "distant" needs a policy with a ``Timing.max_steps`` of at least 150."""


def horizon_named(name: str, timing: Timing) -> Horizon:
    """Return a horizon by name; "all" is every length that a timing allows.

    Raises:
        TaskError: for an unknown name, or a setting with commands longer than the timing allows.

    >>> horizon_named("all", Timing(max_steps=100))
    Horizon(shortest=1, longest=100)
    """
    if name == "all":
        return Horizon(1, timing.max_steps)
    if not isinstance(name, str) or name not in HORIZONS:
        raise TaskError(f"horizon is {name!r}, expected one of: {', '.join(HORIZONS)}, all")
    if HORIZONS[name].longest > timing.max_steps:
        told = f"expected at most the policy's {timing.max_steps}; 'all' is every length up to that"
        raise TaskError(f"horizon {name!r}: {HORIZONS[name].longest} control steps, {told}")
    return HORIZONS[name]


class CommandSchedule:
    """Fixed sequence of commands along every clip, the same for every policy.

    Commands follow each other from the first frame. The last one ends on the clip's last frame; a remainder that is
    shorter than the horizon's shortest command is not commanded.

    Args:
        library: motions.
        horizon: range that the lengths are drawn from.
        seed: of the random lengths; clip ``i`` has the same commands whatever the other clips.

    Raises:
        MotionError: when a clip is too short for a single command.
        TaskError: for what is no horizon.

    >>> from plat.motions import MotionLibrary, generate_motions
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> schedule = CommandSchedule(library, HORIZONS["long"], seed=0)
    >>> first = int(schedule.target_frame[0])
    >>> 26 <= first <= 50, int(schedule.target_frame[first - 1]) == first
    (True, True)
    """

    def __init__(self, library: MotionLibrary, horizon: Horizon, seed: int):
        check_value("commands: seed", seed, Seed)
        _check_horizon(horizon)
        check_clip_lengths(library, horizon)
        arrivals = []
        for clip, length in enumerate(library.clip_length.tolist()):
            generator = torch.Generator().manual_seed(seed * 1_000_003 + clip)
            last, frame, ends = length - 1, 0, []
            while last - frame >= horizon.shortest:
                steps = torch.randint(horizon.shortest, horizon.longest + 1, (), generator=generator)
                frame = min(frame + int(steps), last)
                ends.append(frame)
            arrivals.append(ends)
        self._set(library, horizon, arrivals)

    @classmethod
    def of_arrivals(cls, library: MotionLibrary, arrivals: Sequence[Sequence[int]]) -> "CommandSchedule":
        """Return the schedule whose commands end at given frames.

        Args:
            library: motions.
            arrivals: for each clip, the frames at which its commands end, counted from its first one and increasing.

        Raises:
            TaskError: for arrivals of another number of clips, none, and those that are not in order within their clip.
        """
        if len(arrivals) != library.num_clips or not any(map(len, arrivals)):
            raise TaskError(
                f"commands: arrivals in {counted(len(arrivals), 'clip')}, {sum(map(len, arrivals))} in all, "
                f"expected some in {counted(library.num_clips, 'clip')}"
            )
        for name, length, ends in zip(library.clip_names, library.clip_length.tolist(), arrivals, strict=True):
            if any(begin >= end for begin, end in pairwise((0, *ends, length))):
                raise TaskError(
                    f"commands: motion {name!r} has arrivals at {shown(list(ends))}, expected frames in ascending "
                    f"order, from 1 to {length - 1}"
                )
        lengths = [end - begin for ends in arrivals for begin, end in pairwise((0, *ends))]
        schedule = cls.__new__(cls)
        schedule._set(library, Horizon(min(lengths), max(lengths)), arrivals)
        return schedule

    def _set(self, library: MotionLibrary, horizon: Horizon, arrivals: Sequence[Sequence[int]]) -> None:
        self.horizon = horizon
        self._num_parts = KeyframeCommand.num_parts(library.robot)
        target = torch.full((len(library),), -1, dtype=torch.int64)
        command = torch.full((len(library),), -1, dtype=torch.int64)
        first_frames: list[int] = []
        for start, ends in zip(library.clip_start.tolist(), arrivals, strict=True):
            for begin, end in pairwise((0, *ends)):
                target[start + begin : start + end] = start + end
                command[start + begin : start + end] = len(first_frames)
                first_frames.append(start + begin)
        self.target_frame = target.to(library.device)
        """Target of the command that is active at each frame ``[F]``; -1 where there is none."""
        self.command_of_frame = command.to(library.device)
        """Number of the command that is active at each frame ``[F]``; -1 where there is none."""
        self.first_frame = torch.tensor(first_frames)
        """Frame at which each command is issued, in the order of the library."""
        self.parts: Tensor | None = None
        """What each command commands ``[M, J + K + 3]``, see :class:`plat.spec.parts.Parts`; None for whole poses."""

    def with_parts(self, parts: Tensor) -> "CommandSchedule":
        """Return the same commands for parts of the poses.

        Args:
            parts: masks ``[M, J + K + 3]``, or one for all commands ``[J + K + 3]``.

        Raises:
            TaskError: for masks of another shape, and one of nothing.
        """
        parts = torch.as_tensor(parts)
        if parts.shape not in ((self._num_parts,), (self.num_commands, self._num_parts)):
            expected = f"({self.num_commands}, {self._num_parts}) or ({self._num_parts},)"
            raise TaskError(f"commands: parts have shape {tuple(parts.shape)}, expected {expected}")
        if not (parts > 0).any(-1).all():  # it could not fail but by a fall, and would count as met
            raise TaskError("commands: parts of a command are all 0, expected something to be commanded")
        schedule = copy.copy(self)
        schedule.parts = parts.float().to(self.target_frame.device).expand(self.num_commands, -1)
        return schedule

    @property
    def num_commands(self) -> int:
        """Return the number of commands over all clips."""
        return len(self.first_frame)


def _check_horizon(horizon: Horizon) -> None:
    """Raise :class:`TaskError` for what is no horizon."""
    if not isinstance(horizon, Horizon):
        raise TaskError(f"horizon is {horizon!r}, expected a Horizon, as in HORIZONS['mixed'] or horizon_named")


def check_clip_lengths(library: MotionLibrary, horizon: Horizon) -> None:
    """Raise :class:`MotionError` naming the first clip that cannot hold the horizon's shortest command."""
    too_short = (library.clip_length - 1 < horizon.shortest).nonzero()[:, 0].tolist()
    if too_short:
        clip = too_short[0]
        steps = int(library.clip_length[clip]) - 1
        raise MotionError(
            f"motion {library.clip_names[clip]!r}: {counted(steps, 'control step')} ({steps * library.dt:.2f} s), "
            f"shorter than the shortest command of {counted(horizon.shortest, 'step')} "
            f"({len(too_short)} of {counted(library.num_clips, 'clip')}): drop it or choose a shorter horizon"
        )


def check_timing(library: MotionLibrary, horizon: Horizon, timing: Timing) -> None:
    """Raise a :class:`PlatError` for motions or commands that do not fit a policy's timing.

    Raises:
        PlatError: when the motions have another control step, the horizon's longest command is too long, or it is
            no :class:`Horizon`.
    """
    _check_horizon(horizon)
    timing.check_control_dt(library.dt, f"motion library of {counted(library.num_clips, 'clip')}")
    timing.check_steps(horizon.longest, f"horizon of {horizon.shortest} to {horizon.longest} steps")


class KeyframeClock(Transform):
    """Transform that counts the active command down and marks its arrival window.

    Put it before the transforms that read the window, and :class:`KeyframeCommand` after them. It keeps
    ``("command", "target_frame")`` of the previous step and writes ``("command", "steps_left")`` ``[1]``. For the
    command that the step belonged to, it writes ``("command", "in_window")`` and ``("command", "arrived")``, each
    ``[1]``. Of partial keyframes it keeps what is commanded, ``("command", "parts")``.

    Args:
        window: control steps of the arrival window, the arrival step among them.
        num_parts: ``J + K + 3`` for partial keyframes; 0 for whole ones, where ``("command", "parts")`` is not there.
    """

    def __init__(self, window: int = Timing.window, num_parts: int = 0):
        super().__init__()
        check_value("commands: window", window, Count)
        check_value("commands: num_parts", num_parts, Natural)
        self._window = window
        self._num_parts = num_parts

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        steps_left = tensordict["command", "steps_left"] - 1
        next_tensordict["command", "target_frame"] = tensordict["command", "target_frame"]
        next_tensordict["command", "steps_left"] = steps_left
        next_tensordict["command", "in_window"] = steps_left < self._window
        next_tensordict["command", "arrived"] = steps_left == 0
        if self._num_parts:
            next_tensordict["command", "parts"] = tensordict["command", "parts"]
        return next_tensordict

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        frame = tensordict_reset["motion", "frame"]
        tensordict_reset["command", "target_frame"] = frame
        tensordict_reset["command", "steps_left"] = torch.zeros_like(frame)[:, None]
        for flag in ("in_window", "arrived"):
            tensordict_reset["command", flag] = torch.zeros_like(frame, dtype=torch.bool)[:, None]
        if self._num_parts:
            tensordict_reset["command", "parts"] = torch.ones(len(frame), self._num_parts, device=frame.device)
        return tensordict_reset

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Add the command's entries."""
        count, device = observation_spec.shape, observation_spec.device
        observation_spec["command"] = Composite(
            target_frame=Unbounded(count, dtype=torch.int64, device=device),
            steps_left=Unbounded((*count, 1), dtype=torch.int64, device=device),
            in_window=Unbounded((*count, 1), dtype=torch.bool, device=device),
            arrived=Unbounded((*count, 1), dtype=torch.bool, device=device),
            shape=count,
            device=device,
        )
        if self._num_parts:
            observation_spec["command", "parts"] = Unbounded((*count, self._num_parts), device=device)
        return observation_spec


class KeyframeCommand(ObservationTransform):
    """Transform that issues timed keyframe commands and adds the active one as a goal.

    Where ``("command", "steps_left")`` is 0, a new target is set: from ``schedule``, or a uniform draw of the horizon
    that is cut at the clip's end. Writes ``("command", "target_frame")`` ``[]``, ``("command", "steps_left")``
    ``[1]``, ``("command", "horizon")`` ``[1]`` (``tau = steps_left / Delta_max``) and the goal group: the target in
    the robot's frame, see :func:`plat.envs.robot_centric_goal`. It also writes the groups that some policies read:
    ``"parts"``, what is commanded, and ``"clock"``, the last 0.2 s.

    Args:
        library: motions.
        horizon: range of the commands' lengths.
        schedule: fixed commands; None draws them at random.
        group: name of the goal group.
        timing: of the policy; None for the default at the library's control step.
        partial: share of the random commands that are partial keyframes, of the kinds in
            :data:`plat.envs.part_masks.PART_KINDS`. A schedule brings its own.

    Partial keyframes need a :class:`KeyframeClock` that keeps ``("command", "parts")``, see :meth:`num_parts`.

    Raises:
        MotionError: when a clip is shorter than the horizon's shortest command.
        PlatError: when library or horizon do not fit the timing.
    """

    def __init__(
        self,
        library: MotionLibrary,
        horizon: Horizon,
        schedule: CommandSchedule | None = None,
        group: str = "goal",
        timing: Timing | None = None,
        partial: float = 0.0,
    ):
        check_value("commands: partial", partial, Fraction)
        timing = timing or Timing(control_dt=library.dt)
        check_timing(library, horizon, timing)
        check_clip_lengths(library, horizon)
        robot = library.robot
        masks = None
        if schedule is not None:
            masks = schedule.parts
        elif partial:
            masks = draw_parts(robot, NUM_MASKS).float().to(library.device)
        num_parts = self.num_parts(robot) if masks is not None else 0
        in_keys: list[NestedKey] = [
            ("motion", "frame"),
            ("command", "target_frame"),
            ("command", "steps_left"),
            ("estimate", "root_pos_w"),
            ("estimate", "root_quat_w"),
        ]
        kept: dict[NestedKey, tuple[int, ...]] = {("command", "target_frame"): (), ("command", "steps_left"): (1,)}
        if num_parts:
            in_keys.append(("command", "parts"))
            kept["command", "parts"] = (num_parts,)
        groups = {"command": "command", group: "goal", "parts": "parts", "clock": "clock"}
        super().__init__(
            in_keys=in_keys,
            out_shapes={
                **kept,
                **{(name, key): shape for name, of in groups.items() for key, shape in entry_shapes(of, robot).items()},
            },
            out_dtypes={("command", "target_frame"): torch.int64, ("command", "steps_left"): torch.int64},
        )
        self._library = library
        self._horizon = horizon
        self._schedule = schedule
        self._group = group
        self.timing = timing
        """Timing of the commands, which a policy has to have been made for."""
        self._partial = partial
        self._masks = masks
        self._whole = torch.ones(self.num_parts(robot), device=library.device)

    @staticmethod
    def num_parts(robot: Robot) -> int:
        """Return the number of flags that say what a keyframe commands: joints, bodies, and 3 of the root."""
        return robot.num_joints + len(robot.keypoints) + 3

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        frame, steps_left = tensordict["motion", "frame"], tensordict["command", "steps_left"]
        over = steps_left[:, 0] == 0
        target_frame = torch.where(over, self._next_target(frame), tensordict["command", "target_frame"])
        # at the clip's end no target is left: the episode is over, and no action follows this command
        steps_left = (target_frame - frame).clamp_min(1)[:, None]
        out: dict[NestedKey, Tensor] = {
            ("command", "target_frame"): target_frame,
            ("command", "steps_left"): steps_left,
        }
        parts = None
        if self._masks is not None:
            parts = torch.where(over[:, None], self._next_parts(frame), tensordict["command", "parts"])
            out["command", "parts"] = parts
        goal = robot_centric_goal(
            self._library.poses(target_frame),
            tensordict["estimate", "root_pos_w"],
            tensordict["estimate", "root_quat_w"],
            parts,
        )
        groups = {
            "command": as_observed("command", {"horizon": steps_left / self.timing.max_steps}),
            self._group: goal,
            "parts": parts_entries(self._whole.expand(len(frame), -1) if parts is None else parts, self._library.robot),
            "clock": clock_entries(steps_left, self.timing),
        }
        return out | {(name, key): value for name, group in groups.items() for key, value in group.items()}

    def _next_parts(self, frame: Tensor) -> Tensor:
        """Masks ``[N, J + K + 3]`` of new commands."""
        assert self._masks is not None
        if self._schedule is not None:
            command = self._schedule.command_of_frame[frame]
            return torch.where(command[:, None] < 0, 1.0, self._masks[command])
        row = torch.randint_like(frame, 1, len(self._masks))
        return self._masks[torch.where(torch.rand(len(row), device=row.device) < self._partial, row, 0)]

    def _next_target(self, frame: Tensor) -> Tensor:
        if self._schedule is not None:
            scheduled = self._schedule.target_frame[frame]
            return torch.where(scheduled < 0, frame, scheduled)
        steps = torch.randint_like(frame, self._horizon.shortest, self._horizon.longest + 1)
        return (frame + steps).minimum(self._library.last_of(frame))
