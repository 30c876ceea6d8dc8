"""What a control step on the way to a keyframe costs."""

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn

from plat.envs.state import GeneralizedState
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot
from plat.tasks.authored_line import AuthoredLine, Way
from plat.tasks.balance import Balance
from plat.tasks.chain_rows import ChainRows
from plat.tasks.costs import pose_cost, tracking_cost
from plat.tasks.distances import smooth_length
from plat.tasks.keyframe_masks import KeyframeMasks
from plat.tasks.near_miss import NearMiss, end_effector_mask
from plat.tasks.partial_costs import partial_pose_cost, points_cost
from plat.tasks.pose_table import PoseTable
from plat.tasks.rows import for_some
from plat.tasks.settings import TimedKeyframesConfig

__all__ = ["KeyframeCosts"]

# how much further than the line a robot may lean without cost (difference of unit vectors)
_LEAN = 0.3
# balance is looked at in one of so many steps, and counts as often then: all bodies' kinematics take their time
_BALANCE_EVERY = 4
# a robot this near to a pose can hold it (m)
_AT_PLACE = 0.2


class KeyframeCosts(nn.Module):
    """Distance from a motion, or from the line to an authored keyframe, and in its window from the keyframe.

    Args:
        robot: the robot.
        config: sources and weights.
        window: control steps of an arrival window.
        table: motions and authored keyframes.
        line: between authored keyframes.
        chains: that these are of.
        masks: of partial keyframes.
    """

    _end_effectors: Tensor

    def __init__(
        self,
        robot: Robot,
        config: TimedKeyframesConfig,
        window: int,
        *,
        table: PoseTable,
        line: AuthoredLine,
        chains: ChainRows,
        masks: KeyframeMasks,
    ):
        super().__init__()
        self._robot, self._config, self._window = robot, config, window
        self._table, self._line, self._chains, self._masks = table, line, chains, masks
        self._kinematics, self._balance = ForwardKinematics(robot), Balance(robot)
        ends = end_effector_mask(robot)
        self.register_buffer("_end_effectors", ends, persistent=False)
        self._near_miss = NearMiss(robot.anchor_index, ends, window)

    def forward(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Compute the cost ``[N]`` of the step that ended in states.

        Args:
            state: in the worlds of the motions (:func:`plat.tasks.moved_motion.on_motion`).
            memory: of :class:`plat.tasks.TimedKeyframes`.
        """
        weights, moderate = self._config.tracking, self._config.underway
        in_window = memory["steps_left"] < self._window
        along = tracking_cost(state, self._table.state(memory["frame"]), weights)
        goal = self._table.state(memory["goal"])
        way = self._line.way(memory)
        line = self._line.state(way)
        # who is still far from what it was told to hold has to go there, and pays for nothing that going takes
        near = (state.root_pos_w - goal.root_pos_w).norm(dim=-1) < _AT_PLACE
        held = near & (memory["before"] == memory["goal"])
        share = torch.where(in_window, 1.0, torch.where(way.around, moderate.around, moderate.underway))
        if self._config.partial:
            parts, whole = self._masks.table[memory["parts"]], memory["parts"] == 0
            along = torch.where(whole, 1.0, self._config.partial_tracking) * along
            at_goal, at_line = (partial_pose_cost(state, pose, parts, weights) for pose in (goal, line))
            pull = torch.where(way.around, moderate.around, moderate.not_commanded)
            left_open = torch.where(whole, 0.0, pull) * pose_cost(state, line, weights)
        else:
            at_goal, at_line = pose_cost(state, goal, weights), pose_cost(state, line, weights)
            left_open = torch.zeros_like(at_line)
        points = self._points_cost(state, memory, way, in_window)
        at_goal, at_line = at_goal + points, at_line + points
        along = along + in_window * at_goal
        authored = (
            share * at_line
            + left_open
            + moderate.height * (state.root_pos_w[:, 2] - line.root_pos_w[:, 2]).abs()
            + moderate.root_lin_vel * smooth_length(state.root_lin_vel_w)
            + moderate.root_ang_vel * state.root_ang_vel_b.abs().mean(-1)
            + torch.where(held, moderate.still, moderate.joint_vel) * state.joint_vel.abs().mean(-1)
            + moderate.lean * (smooth_length(state.in_root_frame()[0] - line.in_root_frame()[0]) - _LEAN).relu()
        )
        if moderate.arrival:
            # nobody knows where the next keyframe is: who arrives at rest can go back as well as on
            within_reach = ~self._chains.roams[self._chains.chain(memory["goal"])]
            arrives = in_window & (memory["before"] != memory["goal"]) & within_reach
            authored = authored + moderate.arrival * arrives * smooth_length(state.root_lin_vel_w)
        if moderate.balance:
            looked_at = held & memory["authored"] & (memory["age"] % _BALANCE_EVERY == 0)
            unbalance = for_some(looked_at, lambda rows: self._balance(state.at(rows)))
            authored = authored + _BALANCE_EVERY * moderate.balance * unbalance
        return torch.where(memory["authored"], authored, along)

    def _points_cost(self, state: GeneralizedState, memory: TensorDictBase, way: Way, in_window: Tensor) -> Tensor:
        """Weighted distance ``[N]`` of bodies from where they are to be, mean over a robot's.

        Those that a partial keyframe commands count in its arrival window, and of authored ones on the whole way to it.
        Of a whole keyframe the end effectors count in the window: a hip that is a little off is a foot that is far off.
        What comes near to a miss (:class:`plat.tasks.near_miss.NearMiss`) is added.
        """
        weights, authored = self._config.tracking, memory["authored"]
        at_ends = weights.end_effectors > 0 or weights.miss > 0
        bodies, counts = self._end_effectors.expand(len(authored), -1), in_window & at_ends
        weight = torch.full_like(state.root_pos_w[:, 0], weights.end_effectors)
        parts: Tensor | None = None
        if self._config.partial:
            whole, parts = memory["parts"] == 0, self._masks.table[memory["parts"]]
            bodies = torch.where(whole[:, None], bodies, parts[:, self._robot.num_joints : -3])
            commanded = (in_window | authored) & (bodies > 0).any(-1)
            counts = torch.where(whole, counts, commanded | (in_window & (weights.miss > 0)))
            weight = torch.where(whole, weight, weights.bodies)

        def of(rows: Tensor | slice) -> Tensor:
            here, authored_here = state.at(rows), authored[rows][:, None, None]
            points = self._kinematics.positions(here.root_pos_w, here.root_quat_w, here.joint_pos)
            line = self._line.points(way.at(rows))
            now = self._table.points(memory["frame"][rows])
            cost = weight[rows] * points_cost(points, torch.where(authored_here, line, now), bodies[rows])
            if weights.miss:
                chain = self._chains.chain(memory["goal"][rows])
                near_miss = self._near_miss(
                    here,
                    self._table.state(torch.where(authored, memory["goal"], memory["frame"])[rows]),
                    points,
                    torch.where(authored_here, self._table.points(memory["goal"][rows]), now),
                    None if parts is None else parts[rows],
                    reached_within=self._chains.reached_within[chain],
                    arrives=(authored & (memory["steps_left"] == 0))[rows],
                )
                cost = cost + weights.miss * in_window[rows] * near_miss
            return cost

        return for_some(counts, of)
