"""The task of a keyframe policy: be at one future keyframe on time, then at the next."""

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from plat.bounds import Seed, check_value
from plat.envs.goals import clock_entries, parts_entries, robot_centric_goal, strided_offsets
from plat.envs.parts import NUM_MASKS, draw_parts
from plat.envs.reach import distances
from plat.envs.settings import ReachLimits
from plat.envs.state import GeneralizedState
from plat.envs.tracking import ResetNoise
from plat.envs.transforms.settings import TerminationLimits
from plat.gpu import HORIZONTAL, UP, constant, on_gpu
from plat.keyframes.chain_families import FAMILY_TABLE
from plat.motions.library import MotionLibrary
from plat.robots.kinematics import ForwardKinematics
from plat.rotations import quat_angle, quat_conjugate, quat_multiply, quat_rotate, quat_rotate_inverse, quat_yaw
from plat.spec.observation import as_observed
from plat.spec.timing import Timing
from plat.tasks.authored_line import AuthoredLine, Way
from plat.tasks.balance import Balance
from plat.tasks.chains import draw_chains
from plat.tasks.costs import pose_cost, tracking_cost
from plat.tasks.dense_tracking import START_NOISE, off_reference
from plat.tasks.distances import smooth_length
from plat.tasks.near_miss import NearMiss, end_effector_mask
from plat.tasks.partial import partial_pose_cost, points_cost
from plat.tasks.pose_table import PoseTable
from plat.tasks.rows import for_some
from plat.tasks.settings import TimedKeyframesConfig
from plat.tasks.starts import ClipStarts, FailureWeights, disturbed
from plat.tasks.task import Task, robot_entries
from plat.words import counted

__all__ = ["TimedKeyframes", "TimedKeyframesConfig"]

# how much further than the line a robot may lean without cost (difference of unit vectors)
_LEAN = 0.3
# balance is looked at in one of so many steps, and counts as often then: all bodies' kinematics take their time
_BALANCE_EVERY = 4
# a robot this near to a pose can hold it (m)
_AT_PLACE = 0.2
# how far a robot may be left behind by keyframes out of reach (m)
_BEHIND = 8.0


class TimedKeyframes(Task):
    """Stages 2 and 3 at once: keyframes out of motions and authored ones, each with the time to be there.

    The policy sees what it sees in :func:`plat.envs.make_keyframe_env`: the groups ``"robot"``, ``"goal"`` and
    ``"command"``, and if it asks for them ``"parts"`` and ``"clock"``. Where a command is from a motion, a step costs
    the distance from that motion, which the policy does not see, and in the arrival window that from the keyframe as
    well. An authored keyframe has no reference: before its window it costs a share of the distance from the straight
    line to it, and height and speeds a little. Where that line leads through the robot itself, it is bent, around the
    arms, and its pull is stronger.

    A share of the commands are partial keyframes. Along a
    motion the cost of what a partial keyframe leaves open is still the distance from the motion, as a weaker pull. A
    robot that was free to go elsewhere goes on from there: the motion is moved to where the robot is.

    The memory holds ``last_action``, ``frame`` of the motion, rows of the commanded pose ``goal`` and of the one
    ``before`` it, ``steps_left`` of how many in all (``length``), ``age`` of the episode, and whether it is
    ``authored``. With partial keyframes it also holds the row of the mask ``parts``, and where the motion was moved to:
    ``anchor_pos`` and ``anchor_quat``.

    Args:
        library: motions.
        config: sources and costs.
        timing: of the policy; None for the default at the control step of the motions.
        reset_noise: on the starting states; None starts on the reference.
        seed: draws the authored chains.

    Raises:
        PlatError: when motions or ``config.shortest`` do not fit the timing, or no chains can be drawn.

    >>> from plat.motions import generate_motions
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> task = TimedKeyframes(library, TimedKeyframesConfig(chains=6))
    >>> state, memory = task.start(3)
    >>> task.observe(state, memory)["command", "horizon"].shape
    torch.Size([3, 1])
    """

    static = True
    _steps_to: Tensor
    _next_row: Tensor
    _chain: Tensor
    _first_row: Tensor
    _duration: Tensor
    _moves: Tensor
    _roams: Tensor
    _mask: Tensor
    _end_effectors: Tensor
    _reached_within: Tensor
    parts: Tensor

    def __init__(
        self,
        library: MotionLibrary,
        config: TimedKeyframesConfig | None = None,
        *,
        timing: Timing | None = None,
        reset_noise: ResetNoise | None = START_NOISE,
        seed: int = 0,
    ):
        for what, given, hint in (
            ("library", library, MotionLibrary),
            ("config", config, TimedKeyframesConfig | None),
            ("timing", timing, Timing | None),
            ("reset_noise", reset_noise, ResetNoise | None),
            ("seed", seed, Seed),
        ):
            check_value(f"TimedKeyframes: {what}", given, hint)
        super().__init__(library.robot, library.dt)
        self.config = config = config or TimedKeyframesConfig()
        self.timing = timing or Timing(control_dt=library.dt)
        self.timing.check_control_dt(library.dt, f"motion library of {counted(library.num_clips, 'clip')}")
        self.timing.check_steps(config.shortest, "shortest command along a motion (task.shortest)")
        self.reset_noise = reset_noise
        self.chains = chains = draw_chains(library, config.chains, config.families, seed=seed, timing=self.timing)
        self._frames = frames = len(library)
        authored = PoseTable.of_poses(torch.cat((chains.qpos, chains.middle)).cpu(), library.robot)
        self.table = PoseTable.of_library(library).then(authored)
        self._line = AuthoredLine(self.table, chains.middle_row.to(library.device), frames)
        self.starts = ClipStarts(library, uniform=config.uniform_starts)
        self.chain_starts = FailureWeights(len(chains.family), config.uniform_starts)
        for name, value in (
            ("_steps_to", chains.steps),
            ("_next_row", chains.next_row + frames),
            ("_chain", chains.chain),
            ("_first_row", chains.first_row + frames),
            ("_duration", chains.duration),
            ("_moves", chains.moves),
            ("_roams", torch.tensor([name == "far" for name in chains.family], device=library.device)),
            ("parts", self._draw_parts(seed).to(library.device)),
            ("_mask", self._mask_of_chains().to(library.device)),
            ("_end_effectors", end_effector_mask(library.robot).to(library.device)),
            ("_reached_within", self._distances_of_chains().to(library.device)),
        ):
            self.register_buffer(name, value, persistent=False)
        self._kinematics = ForwardKinematics(library.robot)
        self._balance = Balance(library.robot).to(library.device)
        self._near_miss = NearMiss(library.robot.anchor_index, self._end_effectors, self.timing.window)

    def _draw_parts(self, seed: int) -> Tensor:
        """Masks ``[2 R + F, J + K + 3]``: R drawn ones; those with the root, for chains that lead away; those of chains
        that are of one kind.
        """
        drawn = draw_parts(self.robot, NUM_MASKS, seed).float()
        rooted = drawn.clone()
        rooted[:, -3:] = 1.0
        fixed = [draw_parts(self.robot, 2, seed, [kind], root=False)[1:].float() for kind in self._kinds()]
        return torch.cat((drawn, rooted, *fixed))

    def _kinds(self) -> list[str]:
        """Kinds of masks that whole chains are of."""
        return sorted({kind for kind in self.chains.commands if kind})

    def _mask_of_chains(self) -> Tensor:
        """Row ``[C]`` of the mask that all keyframes of a chain have; 0 where it is drawn."""
        row = {kind: 2 * NUM_MASKS + number for number, kind in enumerate(self._kinds())}
        return torch.tensor([row.get(kind, 0) for kind in self.chains.commands])

    def _distances_of_chains(self) -> Tensor:
        """Largest distance ``[C]`` of a commanded body with which a chain's keyframes are reached (m)."""
        usual = ReachLimits().bodies
        return torch.tensor([FAMILY_TABLE[name].bodies or usual for name in self.chains.family])

    @property
    def partial(self) -> bool:
        """Whether some keyframes command a part of a pose."""
        return self.config.partial > 0

    def start(self, count: int) -> tuple[GeneralizedState, TensorDict]:
        """Starts along motions and of authored chains, in the configured share."""
        authored = torch.rand(count, device=self._chain.device) < self.config.authored
        clips, chains = self.along(self.starts.draw(count)), self.authored(self.chain_starts.draw(count))
        state = GeneralizedState(
            *(torch.where(authored[:, None], ours, theirs) for ours, theirs in zip(chains[0], clips[0], strict=True))
        )
        memory = {
            key: torch.where(authored[:, None] if value.ndim > 1 else authored, chains[1][key], value)
            for key, value in clips[1].items()
        }
        return state, TensorDict(memory, [count], device=authored.device)

    def along(self, frame: Tensor) -> tuple[GeneralizedState, TensorDict]:
        """Starts at frames ``[n]`` of the motions, each with its first command."""
        state = self._disturbed(self.table.state(frame))
        memory = self._memory(len(frame), frame=frame, goal=frame, before=frame)
        return state, self.renew(memory, state)

    def authored(self, chain: Tensor) -> tuple[GeneralizedState, TensorDict]:
        """Starts of authored chains ``[n]``: standing, or in a moment of a motion that is moved to the origin."""
        row = self._first_row[chain]
        moment = self._at_origin(self.table.state(self.starts.draw(len(chain))))
        standing = torch.rand(len(chain), 1, device=row.device) < self.config.from_standing
        parts = zip(self.table.state(row), moment, strict=True)
        state = self._disturbed(GeneralizedState(*(torch.where(standing, ours, theirs) for ours, theirs in parts)))
        memory = self._memory(len(chain), frame=torch.zeros_like(row), goal=row, before=row)
        return state, self.renew(memory.set("authored", torch.ones_like(memory["authored"])), state)

    def observe(self, state: GeneralizedState, memory: TensorDictBase) -> TensorDict:
        """Groups ``"robot"``, ``"goal"``, ``"command"``, ``"clock"``, and ``"parts"``: of whole poses all ones."""
        parts = self.parts[memory["parts"]] if self.partial else None
        here = self._on_motion(state, memory)
        goal = robot_centric_goal(self.table.pose(memory["goal"]), here.root_pos_w, here.root_quat_w, parts)
        steps_left = memory["steps_left"][:, None]
        shown = self.parts[:1].expand(len(steps_left), -1) if parts is None else parts
        groups = {
            "robot": robot_entries(state, memory["last_action"], self.robot),
            "goal": goal,
            "command": as_observed("command", {"horizon": steps_left / self.timing.max_steps}),
            "parts": parts_entries(shown, self.robot),
            "clock": clock_entries(steps_left, self.timing),
        }
        batch, device = memory.batch_size, memory["goal"].device
        entries = {name: TensorDict(group, batch, device=device) for name, group in groups.items()}
        return TensorDict(entries, batch, device=device)

    def privileged(self, state: GeneralizedState, memory: TensorDictBase) -> TensorDict:
        """Frames of the motion from now to the keyframe; of an authored keyframe, which has none, the keyframe."""
        steps = torch.where(memory["authored"], 0, memory["steps_left"].clamp_min(0))
        offset, length = strided_offsets(steps, self.config.stride)
        first = torch.where(memory["authored"], memory["goal"], memory["frame"])
        rows = torch.minimum(first[:, None] + offset, memory["goal"][:, None])
        here = self._on_motion(state, memory)
        goal = robot_centric_goal(self.table.pose(rows), here.root_pos_w, here.root_quat_w)
        frames = torch.cat(list(goal.values()), -1)
        return TensorDict({"frames": frames, "length": length}, memory.batch_size, device=frames.device)

    def reference(self, memory: TensorDictBase) -> Tensor:
        """Joint angles of the motion, or of the line to an authored keyframe."""
        return self._wanted(memory).joint_pos

    def advance(self, memory: TensorDictBase, action: Tensor) -> TensorDictBase:
        """One frame on along a motion, one step less to the keyframe."""
        frame = memory["frame"]
        out = memory.copy()
        out["last_action"] = action
        out["frame"] = torch.where(memory["authored"], frame, (frame + 1).minimum(self.starts.last_of(frame)))
        out["steps_left"] = memory["steps_left"] - 1
        out["age"] = memory["age"] + 1
        return out

    def renew(self, memory: TensorDictBase, state: GeneralizedState) -> TensorDictBase:
        """The next keyframe where the last one's time is up."""
        due, authored, frame = memory["steps_left"] <= 0, memory["authored"], memory["frame"]
        if not on_gpu(due) and not due.any():  # a GPU would have to be waited for
            return memory
        drawn = self._draw_steps(frame)
        # along a motion: that many frames ahead; of a chain: its next row, and the last one again and again
        chain_row = (memory["goal"] - self._frames).clamp_min(0)
        following = self._next_row[chain_row]
        held = following == memory["goal"]
        goal = torch.where(authored, following, (frame + drawn).minimum(self.starts.last_of(frame)))
        # whoever holds a pose may be told so at every step
        again = torch.where(torch.rand(drawn.shape, device=drawn.device) < 0.5, 1, drawn)
        authored_steps = torch.where(held, again, self._steps_to[(following - self._frames).clamp_min(0)])
        # at the clip's end there is nothing to come: the episode is over, and the command is never acted on
        steps = torch.where(authored, authored_steps, (goal - frame).clamp_min(1))
        out = memory.copy()
        out["before"] = torch.where(due, torch.where(authored, memory["goal"], frame), memory["before"])
        out["goal"] = torch.where(due, goal, memory["goal"])
        out["steps_left"] = torch.where(due, steps, memory["steps_left"])
        out["length"] = torch.where(due, steps, memory["length"])
        if self.partial:
            self._move_motion(out, memory, state, due & ~authored)
            # a pose that is held stays commanded by the parts that it was commanded by
            change = due & ~(authored & held)
            out["parts"] = torch.where(change, self._draw_masks(authored, chain_row), memory["parts"])
        return out

    def _draw_steps(self, frame: Tensor) -> Tensor:
        """Lengths of commands along motions, like ``frame``."""
        config, longest = self.config, self.timing.max_steps
        usual = max(min(self.timing.steps(1.0), longest), config.shortest)
        drawn = torch.randint_like(frame, config.shortest, usual + 1)
        if usual == longest:
            return drawn
        any_length = torch.rand(frame.shape, device=frame.device) < config.distant
        return torch.where(any_length, torch.randint_like(frame, config.shortest, longest + 1), drawn)

    def _draw_masks(self, authored: Tensor, chain_row: Tensor) -> Tensor:
        """Rows of masks for new commands."""
        row = torch.randint_like(chain_row, 1, NUM_MASKS)
        chain = self._chain[chain_row]
        row = torch.where(authored & self._moves[chain], row + NUM_MASKS, row)
        row = torch.where(torch.rand(row.shape, device=row.device) < self.config.partial, row, 0)
        return torch.where(authored & (self._mask[chain] > 0), self._mask[chain], row)

    @torch.no_grad()
    def _move_motion(self, out: TensorDictBase, memory: TensorDictBase, state: GeneralizedState, ended: Tensor) -> None:
        """Move the motion to the robot where the command that ``ended`` left open where the robot goes."""
        parts = self.parts[memory["parts"]]
        open_pos = ended & ~(parts[:, self.robot.num_joints : -2] > 0).any(-1)  # neither bodies nor the root's place
        open_yaw = open_pos & ~(parts[:, -1] > 0)
        here, reference = self._on_motion(state, memory), self.table.state(memory["frame"])
        turned = quat_multiply(quat_yaw(state.root_quat_w), quat_conjugate(quat_yaw(reference.root_quat_w)))
        quat = torch.where(open_yaw[:, None], turned, memory["anchor_quat"])
        on_motion = torch.where(open_pos[:, None], reference.root_pos_w, here.root_pos_w)
        pos = (state.root_pos_w - quat_rotate(quat, on_motion)) * constant(HORIZONTAL, quat)
        out["anchor_quat"], out["anchor_pos"] = quat, torch.where(open_pos[:, None], pos, memory["anchor_pos"])

    def _on_motion(self, state: GeneralizedState, memory: TensorDictBase) -> GeneralizedState:
        """The robot's state in the world of the motion, which may have been moved."""
        if not self.partial:
            return state
        pos, quat = memory["anchor_pos"], memory["anchor_quat"]
        return state._replace(
            root_pos_w=quat_rotate_inverse(quat, state.root_pos_w - pos),
            root_quat_w=quat_multiply(quat_conjugate(quat), state.root_quat_w),
            root_lin_vel_w=quat_rotate_inverse(quat, state.root_lin_vel_w),
        )

    def cost(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Distance ``[N]`` from the motion, or from the line to the keyframe, and in its window from the keyframe."""
        weights, moderate = self.config.tracking, self.config.underway
        state = self._on_motion(state, memory)
        in_window = memory["steps_left"] < self.timing.window
        along = tracking_cost(state, self.table.state(memory["frame"]), weights)
        goal = self.table.state(memory["goal"])
        way = self._line.way(memory)
        line = self._line.state(way)
        # who is still far from what it was told to hold has to go there, and pays for nothing that going takes
        near = (state.root_pos_w - goal.root_pos_w).norm(dim=-1) < _AT_PLACE
        held = near & (memory["before"] == memory["goal"])
        share = torch.where(in_window, 1.0, torch.where(way.around, moderate.around, moderate.underway))
        if self.partial:
            parts, whole = self.parts[memory["parts"]], memory["parts"] == 0
            along = torch.where(whole, 1.0, self.config.partial_tracking) * along
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
            arrives = in_window & (memory["before"] != memory["goal"]) & ~self._roams[self._chain_of(memory["goal"])]
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
        weights, authored = self.config.tracking, memory["authored"]
        at_ends = weights.end_effectors > 0 or weights.miss > 0
        bodies, counts = self._end_effectors.expand(len(authored), -1), in_window & at_ends
        weight = torch.full_like(state.root_pos_w[:, 0], weights.end_effectors)
        parts: Tensor | None = None
        if self.partial:
            whole, parts = memory["parts"] == 0, self.parts[memory["parts"]]
            bodies = torch.where(whole[:, None], bodies, parts[:, self.robot.num_joints : -3])
            commanded = (in_window | authored) & (bodies > 0).any(-1)
            counts = torch.where(whole, counts, commanded | (in_window & (weights.miss > 0)))
            weight = torch.where(whole, weight, weights.bodies)

        def of(rows: Tensor | slice) -> Tensor:
            here, authored_here = state.at(rows), authored[rows][:, None, None]
            points = self._kinematics.positions(here.root_pos_w, here.root_quat_w, here.joint_pos)
            line = self._line.points(way.at(rows))
            now = self.table.points(memory["frame"][rows])
            cost = weight[rows] * points_cost(points, torch.where(authored_here, line, now), bodies[rows])
            if weights.miss:
                chain = self._chain_of(memory["goal"][rows])
                near_miss = self._near_miss(
                    here,
                    self.table.state(torch.where(authored, memory["goal"], memory["frame"])[rows]),
                    points,
                    torch.where(authored_here, self.table.points(memory["goal"][rows]), now),
                    None if parts is None else parts[rows],
                    reached_within=self._reached_within[chain],
                    arrives=(authored & (memory["steps_left"] == 0))[rows],
                )
                cost = cost + weights.miss * in_window[rows] * near_miss
            return cost

        return for_some(counts, of)

    def failed(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Mask ``[N]``: 0.3 m too high or low, too far off, or tilted otherwise than motion or line.

        Where a keyframe leaves the height open, that is 0.5 m, and where it leaves the place open, 2 m.
        """
        state, wanted = self._on_motion(state, memory), self._wanted(memory)
        height, leeway = torch.full_like(state.root_pos_w[:, 2], 0.3), self._leeway(memory)
        if self.partial:
            parts = self.parts[memory["parts"]]
            height = torch.where(parts[:, -2] > 0, height, 0.5)
            leeway = torch.where(parts[:, -3] > 0, leeway, leeway.clamp_min(2.0))
        return off_reference(state, wanted, height=height, distance=leeway)

    @torch.no_grad()
    def missed(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Mask ``[N]`` of robots that miss a keyframe at its arrival, by the thresholds of evaluation.

        Whole keyframes of a motion, and authored ones that are not out of reach. Who holds a pose does not arrive.
        """
        authored, goal = memory["authored"], memory["goal"]
        whole = memory["parts"] == 0 if self.partial else torch.ones_like(authored)
        arrives = (memory["steps_left"] == 0) & torch.where(authored, memory["before"] != goal, whole)
        out = torch.zeros_like(authored)
        rows = arrives.nonzero()[:, 0]
        if len(rows):
            here, there = self._on_motion(state, memory).at(rows), self.table.state(goal[rows])
            places = self._kinematics.positions(here.root_pos_w, here.root_quat_w, here.joint_pos)
            robots, poses = _keypoints(here, places), _keypoints(there, self.table.points(goal[rows]))
            unreached, off = self._unreached(robots, poses, memory[rows]), self._off(robots, poses)
            out[rows] = torch.where(authored[rows], unreached, off)
        return out

    def _off(self, robots: TensorDict, poses: TensorDict) -> Tensor:
        """Mask ``[n]`` of robots that are off whole poses, by the thresholds of TKS."""
        limits = TerminationLimits()
        heights = (robots["keypoint_pos_w"] - poses["keypoint_pos_w"])[..., 2].abs()
        angles = quat_angle(robots["keypoint_quat_w"][:, 0], poses["keypoint_quat_w"][:, 0])
        too_high = (heights > limits.end_effector_height) & (self._end_effectors > 0)
        anchor = heights[:, self.robot.anchor_index] > limits.anchor_height
        return anchor | (angles.square() > limits.anchor_rot_squared) | too_high.any(-1)

    def _unreached(self, robots: TensorDict, poses: TensorDict, memory: TensorDictBase) -> Tensor:
        """Mask ``[n]`` of robots that are not near authored keyframes, of those that are not out of reach."""
        chain = self._chain_of(memory["goal"])
        parts = self.parts[memory["parts"]] if self.partial else None
        near = distances(robots, poses, parts).near(self._near_miss.limits, self._reached_within[chain])
        return ~near & ~self._roams[chain]

    def lost(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Mask ``[N]``: 0.6 m too high or low."""
        return (state.root_pos_w[:, 2] - self._wanted(memory).root_pos_w[:, 2]).abs() > 0.6

    def finished(self, memory: TensorDictBase) -> Tensor:
        """Mask ``[N]``: at the clip's last frame, or at the end of the hold after a chain."""
        frame = memory["frame"]
        over = memory["age"] >= self._duration[self._chain_of(memory["goal"])]
        return torch.where(memory["authored"], over, frame >= self.starts.last_of(frame))

    def record_failures(self, memory: TensorDictBase) -> None:
        """Start more episodes in the seconds, and of the chains, of these failures ``[n]``."""
        self.starts.weights.forget()
        self.chain_starts.forget()
        authored = memory["authored"]
        self.starts.record(memory["frame"][~authored])
        self.chain_starts.record(self._chain_of(memory["goal"][authored]))

    def _memory(self, count: int, **rows: Tensor) -> TensorDict:
        device = self._chain.device
        zero = torch.zeros(count, dtype=torch.int64, device=device)
        if self.partial:
            quat = torch.nn.functional.pad(self.parts.new_ones(count, 1), (0, 3))
            rows |= {"parts": zero.clone(), "anchor_pos": self.parts.new_zeros(count, 3), "anchor_quat": quat}
        return TensorDict(
            {
                "last_action": self.parts.new_zeros(count, self.robot.num_joints),
                **rows,
                "steps_left": zero,
                "length": zero + 1,
                "age": zero.clone(),
                "authored": zero > 0,
            },
            [count],
            device=device,
        )

    def _disturbed(self, state: GeneralizedState) -> GeneralizedState:
        return state if self.reset_noise is None else disturbed(state, self.reset_noise, self.robot)

    def _at_origin(self, state: GeneralizedState) -> GeneralizedState:
        """The same states ``[n]`` at the origin, looking along x."""
        back = quat_conjugate(quat_yaw(state.root_quat_w))
        height = state.root_pos_w * constant(UP, state.root_pos_w)
        return state._replace(
            root_pos_w=height,
            root_quat_w=quat_multiply(back, state.root_quat_w),
            root_lin_vel_w=quat_rotate(back, state.root_lin_vel_w),
        )

    def _chain_of(self, goal: Tensor) -> Tensor:
        """Number ``[N]`` of the chain that authored keyframes are of; 0 for frames of a motion."""
        return self._chain[(goal - self._frames).clamp_min(0)]

    def _wanted(self, memory: TensorDictBase) -> GeneralizedState:
        """The motion, or the line between authored keyframes."""
        authored, frame = memory["authored"][:, None], self.table.state(memory["frame"])
        pairs = zip(self._line.state(self._line.way(memory)), frame, strict=True)
        return GeneralizedState(*(torch.where(authored, ours, theirs) for ours, theirs in pairs))

    def _leeway(self, memory: TensorDictBase) -> Tensor:
        """How far off a robot may be (m): an authored keyframe may be out of reach in its time.

        A robot that is sent where it cannot be in time is left behind further with every command.
        """
        before, after = (self.table.points(memory[key])[:, 0] for key in ("before", "goal"))
        way = (before - after).norm(dim=-1)
        chain = self._chain_of(memory["goal"])
        way = torch.where(self._roams[chain], _BEHIND, way)
        return 0.8 + memory["authored"] * torch.where(way > 1.0, way, 0.0)


def _keypoints(pose: GeneralizedState, places: Tensor) -> TensorDict:
    """Poses ``[n]`` with keypoints, as :func:`plat.envs.reach.distances` takes them: of orientations the root's."""
    entries = {"keypoint_pos_w": places, "keypoint_quat_w": pose.root_quat_w[:, None], "joint_pos": pose.joint_pos}
    return TensorDict(entries, [len(places)], device=places.device)
