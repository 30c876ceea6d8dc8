"""The task of an expert: follow a reference frame by frame."""

from collections.abc import Mapping

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from plat.bounds import Natural, check_value
from plat.envs.goals import robot_centric_goal
from plat.envs.state import GeneralizedState
from plat.envs.tracking import ResetNoise
from plat.envs.transforms import NEXT_FRAME
from plat.motions.library import MotionLibrary
from plat.robots.kinematics import ForwardKinematics
from plat.rotations import quat_angle, quat_tilt
from plat.tasks.costs import TrackingCosts, tracking_cost
from plat.tasks.near_miss import NearMiss, end_effector_mask
from plat.tasks.partial_costs import points_cost
from plat.tasks.pose_table import PoseTable
from plat.tasks.starts import ClipStarts, disturbed
from plat.tasks.task import Task, robot_entries

__all__ = ["START_NOISE", "DenseTracking"]

START_NOISE = ResetNoise(
    root_pos_xy=0.05,
    root_pos_z=0.01,
    roll_pitch=0.1,
    yaw=0.2,
    root_lin_vel_xy=0.3,
    root_lin_vel_z=0.1,
    root_ang_vel_rp=0.4,
    root_ang_vel_yaw=0.6,
    joint_pos=0.08,
)
"""Noise on the starts of episodes that are learned from by imagination."""


class DenseTracking(Task):
    """Stage 1: be where the reference is, now.

    The policy sees what a :class:`plat.modules.Expert` sees in :func:`plat.envs.make_tracking_env`: the groups
    ``"robot"`` and those of ``goals``. The memory holds ``last_action`` and the ``frame`` of the reference.

    Args:
        library: motions.
        goals: groups in which the reference is shown, and how many frames ahead each is; those of
            :attr:`plat.modules.Expert.goals`.
        costs: weights of the cost. ``end_effectors`` and ``miss`` count in every step.
        reset_noise: on the starting states; None starts on the reference.
        uniform: share of the starts that is uniform over the motions; the others are where episodes failed.

    Raises:
        ConfigError: for a weight of partial keyframes in ``costs`` (``bodies``) that is not the default.

    >>> from plat.motions import generate_motions
    >>> task = DenseTracking(MotionLibrary.from_clips(generate_motions("train", seconds=8)))
    >>> state, memory = task.start(2)
    >>> task.observe(state, memory)["goal", "root_pos_b"].shape, task.cost(state, memory).shape
    (torch.Size([2, 3]), torch.Size([2]))
    """

    static = True
    _ahead: Tensor
    _end_effectors: Tensor

    def __init__(
        self,
        library: MotionLibrary,
        goals: Mapping[str, int] = NEXT_FRAME,
        *,
        costs: TrackingCosts | None = None,
        reset_noise: ResetNoise | None = START_NOISE,
        uniform: float = 0.3,
    ):
        check_value("DenseTracking: library", library, MotionLibrary)
        check_value("DenseTracking: goals", goals, Mapping)
        for group, ahead in goals.items():
            check_value(f"DenseTracking: goal {group!r}: frames ahead", ahead, Natural)
        check_value("DenseTracking: costs", costs, TrackingCosts | None)
        check_value("DenseTracking: reset_noise", reset_noise, ResetNoise | None)
        super().__init__(library.robot, library.dt)
        self.costs = costs or TrackingCosts()
        self.costs.check_dense("DenseTracking: costs")
        self.reset_noise = reset_noise
        self.table = PoseTable.of_library(library)
        self.starts = ClipStarts(library, uniform=uniform)
        self._kinematics = ForwardKinematics(library.robot)
        ends = end_effector_mask(library.robot).to(library.device)
        self.register_buffer("_end_effectors", ends, persistent=False)
        self._near_miss = NearMiss(library.robot.anchor_index, ends, window=1)
        self._groups = list(goals)
        self.register_buffer("_ahead", torch.tensor(list(goals.values()), device=library.device), persistent=False)

    def start(self, count: int) -> tuple[GeneralizedState, TensorDict]:
        """Return reference states with noise, at frames that :class:`ClipStarts` draws."""
        return self.at(self.starts.draw(count))

    def at(self, frame: Tensor) -> tuple[GeneralizedState, TensorDict]:
        """Return starts at frames ``[n]``."""
        state = self.table.state(frame)
        if self.reset_noise is not None:
            state = disturbed(state, self.reset_noise, self.robot)
        action = state.joint_pos.new_zeros(len(frame), self.robot.num_joints)
        return state, TensorDict({"last_action": action, "frame": frame}, [len(frame)], device=frame.device)

    def observe(self, state: GeneralizedState, memory: TensorDictBase) -> TensorDict:
        """Return the groups ``"robot"`` and ``goals``; past a clip's end its last frame is shown."""
        frame = memory["frame"]
        rows = (frame[:, None] + self._ahead).minimum(self.starts.last_of(frame)[:, None])
        goal = robot_centric_goal(self.table.pose(rows), state.root_pos_w, state.root_quat_w)
        entries = {"robot": robot_entries(state, memory["last_action"], self.robot)}
        for number, group in enumerate(self._groups):
            shown = {key: value[:, number] for key, value in goal.items()}
            entries[group] = TensorDict(shown, frame.shape, device=frame.device)
        return TensorDict(entries, frame.shape, device=frame.device)

    def advance(self, memory: TensorDictBase, action: Tensor) -> TensorDictBase:
        """Go one frame on, to the clip's last at most."""
        frame = memory["frame"]
        out = memory.copy().set("last_action", action)
        return out.set("frame", (frame + 1).minimum(self.starts.last_of(frame)))

    def cost(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the distance ``[N]`` from the reference."""
        weights, frame = self.costs, memory["frame"]
        reference = self.table.state(frame)
        cost = tracking_cost(state, reference, weights)
        if weights.end_effectors or weights.miss:
            points = self._kinematics.positions(state.root_pos_w, state.root_quat_w, state.joint_pos)
            wanted = self.table.points(frame)
            cost = cost + weights.end_effectors * points_cost(points, wanted, self._end_effectors)
            cost = cost + weights.miss * self._near_miss.off_track(state, reference, points, wanted)
        return cost

    def failed(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]``: 0.25 m too high or low, 0.6 m off, or tilted otherwise than the reference."""
        return off_reference(state, self.table.state(memory["frame"]), height=0.25, distance=0.6)

    def finished(self, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]``: at the clip's last frame."""
        return memory["frame"] >= self.starts.last_of(memory["frame"])

    def lost(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]``: farther than 0.8 m or 1.2 rad from the reference."""
        reference = self.table.state(memory["frame"])
        distance = (state.root_pos_w - reference.root_pos_w).norm(dim=-1)
        return (distance > 0.8) | (quat_angle(state.root_quat_w, reference.root_quat_w) > 1.2)

    def record_failures(self, memory: TensorDictBase) -> None:
        """Start more episodes in the seconds of these failures ``[n]``."""
        self.starts.weights.forget()
        self.starts.record(memory["frame"])


def off_reference(
    state: GeneralizedState,
    reference: GeneralizedState,
    height: float | Tensor,
    distance: float | Tensor,
    tilted: float = 0.8,
) -> Tensor:
    """Return the mask ``[*B]`` of roots too far off in height (m), distance (m) or vertical component of gravity."""
    off = state.root_pos_w - reference.root_pos_w
    return (
        (off[..., 2].abs() > height)
        | (off.norm(dim=-1) > distance)
        | ((quat_tilt(state.root_quat_w) - quat_tilt(reference.root_quat_w)).abs() > tilted)
    )
