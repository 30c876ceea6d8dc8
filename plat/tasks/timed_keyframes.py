"""The task of a keyframe policy: be at one future keyframe on time, then at the next."""

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn

from plat.bounds import Seed, check_value
from plat.envs.goals import clock_entries, parts_entries, robot_centric_goal, strided_offsets
from plat.envs.reach import distances
from plat.envs.settings import ReachLimits
from plat.envs.state import GeneralizedState
from plat.envs.tracking import ResetNoise
from plat.envs.transforms.settings import TerminationLimits
from plat.envs.transforms.terminations import off_pose
from plat.gpu import UP, constant, on_gpu
from plat.motions.library import MotionLibrary
from plat.robots.kinematics import ForwardKinematics
from plat.rotations import quat_conjugate, quat_multiply, quat_rotate, quat_yaw
from plat.spec.observation import as_observed
from plat.spec.timing import Timing
from plat.tasks.authored_line import AuthoredLine
from plat.tasks.chain_rows import ChainRows
from plat.tasks.chains import draw_chains
from plat.tasks.dense_tracking import START_NOISE, off_reference
from plat.tasks.keyframe_costs import KeyframeCosts
from plat.tasks.keyframe_masks import KeyframeMasks
from plat.tasks.moved_motion import moved_motion, on_motion
from plat.tasks.pose_table import PoseTable
from plat.tasks.settings import TimedKeyframesConfig
from plat.tasks.starts import ClipStarts, FailureWeights, disturbed
from plat.tasks.task import Task, robot_entries
from plat.words import counted

__all__ = ["TimedKeyframes", "TimedKeyframesConfig"]

# how far a robot may be left behind by keyframes out of reach (m)
_BEHIND = 8.0


class TimedKeyframes(Task):
    """Stages 2 and 3 at once: keyframes from motions and authored ones, each with its time.

    The policy sees what it sees in :func:`plat.envs.make_keyframe_env`: the groups ``"robot"``, ``"goal"`` and
    ``"command"``, and if it asks for them ``"parts"`` and ``"clock"``. Where a command comes from a motion, a step
    costs the distance from that motion, which the policy does not see. In the arrival window it costs the distance from
    the keyframe as well. An authored keyframe has no reference: before its window it costs a share of the distance from
    the straight line to it, and height and speeds a little. Where that line leads through the robot itself, it is bent,
    around the arms, and its pull is stronger.

    A share of the commands are partial keyframes. Along a motion the cost of what a partial keyframe leaves open is
    still the distance from the motion, as a weaker pull. A robot that was free to go elsewhere goes on from there: the
    motion is moved to where the robot is.

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

    Attributes:
        table: frames of the motions and authored keyframes (:class:`plat.tasks.PoseTable`).
        line: between authored keyframes (:class:`plat.tasks.authored_line.AuthoredLine`).
        chain_rows: which of them follow each other (:class:`plat.tasks.chain_rows.ChainRows`).
        masks: what partial keyframes command (:class:`plat.tasks.keyframe_masks.KeyframeMasks`).
        costs: of a step, a module of a state in the motion's world and the memory, which may be another one
            (:class:`plat.tasks.keyframe_costs.KeyframeCosts`).

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
        frames = len(library)
        authored = PoseTable.of_poses(torch.cat((chains.qpos, chains.middle)).cpu(), library.robot)
        self.table = PoseTable.of_library(library).then(authored)
        self.line = AuthoredLine(self.table, chains.middle_row.to(library.device), frames)
        self.starts = ClipStarts(library, uniform=config.uniform_starts)
        self.chain_starts = FailureWeights(len(chains.family), config.uniform_starts)
        self.chain_rows = ChainRows(chains, frames).to(library.device)
        self.masks = KeyframeMasks(library.robot, chains, config.partial, seed).to(library.device)
        self.costs: nn.Module = KeyframeCosts(
            library.robot,
            config,
            self.timing.window,
            table=self.table,
            line=self.line,
            chains=self.chain_rows,
            masks=self.masks,
        ).to(library.device)
        self._kinematics = ForwardKinematics(library.robot)

    @property
    def partial(self) -> bool:
        """Return whether some keyframes command a part of a pose."""
        return self.config.partial > 0

    def start(self, count: int) -> tuple[GeneralizedState, TensorDict]:
        """Return starts along motions and of authored chains, in the configured share."""
        authored = torch.rand(count, device=self.chain_rows.first_row.device) < self.config.authored
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
        """Return starts at frames ``[n]`` of the motions, each with its first command."""
        state = self._disturbed(self.table.state(frame))
        memory = self._memory(len(frame), frame=frame, goal=frame, before=frame)
        return state, self.renew(memory, state)

    def authored(self, chain: Tensor) -> tuple[GeneralizedState, TensorDict]:
        """Return starts of authored chains ``[n]``: standing, or in a moment of a motion moved to the origin."""
        row = self.chain_rows.first_row[chain]
        moment = self._at_origin(self.table.state(self.starts.draw(len(chain))))
        standing = torch.rand(len(chain), 1, device=row.device) < self.config.from_standing
        parts = zip(self.table.state(row), moment, strict=True)
        state = self._disturbed(GeneralizedState(*(torch.where(standing, ours, theirs) for ours, theirs in parts)))
        memory = self._memory(len(chain), frame=torch.zeros_like(row), goal=row, before=row)
        return state, self.renew(memory.set("authored", torch.ones_like(memory["authored"])), state)

    def observe(self, state: GeneralizedState, memory: TensorDictBase) -> TensorDict:
        """Return groups ``"robot"``, ``"goal"``, ``"command"``, ``"clock"``, ``"parts"``: of whole poses all ones."""
        parts, here = self._commanded(memory), on_motion(state, memory)
        goal = robot_centric_goal(self.table.pose(memory["goal"]), here.root_pos_w, here.root_quat_w, parts)
        steps_left = memory["steps_left"][:, None]
        shown = self.masks.table[:1].expand(len(steps_left), -1) if parts is None else parts
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
        """Return the frames from now to the keyframe; of an authored keyframe, which has no motion, the keyframe."""
        steps = torch.where(memory["authored"], 0, memory["steps_left"].clamp_min(0))
        offset, length = strided_offsets(steps, self.config.stride)
        first = torch.where(memory["authored"], memory["goal"], memory["frame"])
        rows = torch.minimum(first[:, None] + offset, memory["goal"][:, None])
        here = on_motion(state, memory)
        goal = robot_centric_goal(self.table.pose(rows), here.root_pos_w, here.root_quat_w)
        frames = torch.cat(list(goal.values()), -1)
        return TensorDict({"frames": frames, "length": length}, memory.batch_size, device=frames.device)

    def reference(self, memory: TensorDictBase) -> Tensor:
        """Return joint angles of the motion, or of the line to an authored keyframe."""
        return self._wanted(memory).joint_pos

    def advance(self, memory: TensorDictBase, action: Tensor) -> TensorDictBase:
        """Go one frame on along a motion, and one step less to the keyframe."""
        frame = memory["frame"]
        out = memory.copy()
        out["last_action"] = action
        out["frame"] = torch.where(memory["authored"], frame, (frame + 1).minimum(self.starts.last_of(frame)))
        out["steps_left"] = memory["steps_left"] - 1
        out["age"] = memory["age"] + 1
        return out

    def renew(self, memory: TensorDictBase, state: GeneralizedState) -> TensorDictBase:
        """Return the next keyframe where the last one's time is up."""
        due, authored, frame = memory["steps_left"] <= 0, memory["authored"], memory["frame"]
        if not on_gpu(due) and not due.any():  # a GPU would have to be waited for
            return memory
        drawn = self._draw_steps(frame)
        # along a motion: that many frames ahead; of a chain: its next row, and the last one again and again
        following, steps_to = self.chain_rows.following(memory["goal"])
        held = following == memory["goal"]
        goal = torch.where(authored, following, (frame + drawn).minimum(self.starts.last_of(frame)))
        # whoever holds a pose may be told so at every step
        again = torch.where(torch.rand(drawn.shape, device=drawn.device) < 0.5, 1, drawn)
        authored_steps = torch.where(held, again, steps_to)
        # at the clip's end there is nothing to come: the episode is over, and the command is never acted on
        steps = torch.where(authored, authored_steps, (goal - frame).clamp_min(1))
        out = memory.copy()
        out["before"] = torch.where(due, torch.where(authored, memory["goal"], frame), memory["before"])
        out["goal"] = torch.where(due, goal, memory["goal"])
        out["steps_left"] = torch.where(due, steps, memory["steps_left"])
        out["length"] = torch.where(due, steps, memory["length"])
        if (parts := self._commanded(memory)) is not None:
            ended, reference = due & ~authored, self.table.state(frame)
            out["anchor_pos"], out["anchor_quat"] = moved_motion(state, memory, reference, parts, ended)
            # a pose that is held stays commanded by the parts that it was commanded by
            change, chain = due & ~(authored & held), self.chain_rows.chain(memory["goal"])
            masks = self.masks.draw(chain, authored, self.chain_rows.moves[chain])
            out["parts"] = torch.where(change, masks, memory["parts"])
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

    def cost(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the distance ``[N]`` from motion or line to the keyframe, and in its window from the keyframe."""
        cost: Tensor = self.costs(on_motion(state, memory), memory)
        return cost

    def failed(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]``: 0.3 m too high or low, too far off, or tilted otherwise than motion or line.

        Where a keyframe leaves the height open, that is 0.5 m, and where it leaves the place open, 2 m.
        """
        state, wanted = on_motion(state, memory), self._wanted(memory)
        height, leeway = torch.full_like(state.root_pos_w[:, 2], 0.3), self._leeway(memory)
        if (parts := self._commanded(memory)) is not None:
            height = torch.where(parts[:, -2] > 0, height, 0.5)
            leeway = torch.where(parts[:, -3] > 0, leeway, leeway.clamp_min(2.0))
        return off_reference(state, wanted, height=height, distance=leeway)

    @torch.no_grad()
    def missed(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]`` of robots that miss a keyframe at its arrival, by the thresholds of evaluation.

        Whole keyframes of a motion, and authored ones that are not out of reach. Who holds a pose does not arrive.
        """
        authored, goal = memory["authored"], memory["goal"]
        whole = memory["parts"] == 0 if self.partial else torch.ones_like(authored)
        arrives = (memory["steps_left"] == 0) & torch.where(authored, memory["before"] != goal, whole)
        out = torch.zeros_like(authored)
        rows = arrives.nonzero()[:, 0]
        if len(rows):
            here, there = on_motion(state, memory).at(rows), self.table.state(goal[rows])
            places = self._kinematics.positions(here.root_pos_w, here.root_quat_w, here.joint_pos)
            robots, poses = _keypoints(here, places), _keypoints(there, self.table.points(goal[rows]))
            off = off_pose(robots, poses, self.robot, TerminationLimits())
            apart = distances(robots, poses, self._commanded(memory[rows]))
            chain = self.chain_rows.chain(goal[rows])
            reached = apart.near(ReachLimits(), self.chain_rows.reached_within[chain]) | self.chain_rows.roams[chain]
            out[rows] = torch.where(authored[rows], ~reached, off)
        return out

    def lost(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]``: 0.6 m too high or low."""
        return (state.root_pos_w[:, 2] - self._wanted(memory).root_pos_w[:, 2]).abs() > 0.6

    def finished(self, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]``: at the clip's last frame, or at the end of the hold after a chain."""
        frame = memory["frame"]
        over = memory["age"] >= self.chain_rows.duration[self.chain_rows.chain(memory["goal"])]
        return torch.where(memory["authored"], over, frame >= self.starts.last_of(frame))

    def record_failures(self, memory: TensorDictBase) -> None:
        """Start more episodes in the seconds, and of the chains, of these failures ``[n]``."""
        self.starts.weights.forget()
        self.chain_starts.forget()
        authored = memory["authored"]
        self.starts.record(memory["frame"][~authored])
        self.chain_starts.record(self.chain_rows.chain(memory["goal"][authored]))

    def _memory(self, count: int, **rows: Tensor) -> TensorDict:
        device = self.chain_rows.first_row.device
        zero, floats = torch.zeros(count, dtype=torch.int64, device=device), self.masks.table
        if self.partial:
            quat = torch.nn.functional.pad(floats.new_ones(count, 1), (0, 3))
            rows |= {"parts": zero.clone(), "anchor_pos": floats.new_zeros(count, 3), "anchor_quat": quat}
        return TensorDict(
            {
                "last_action": floats.new_zeros(count, self.robot.num_joints),
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

    def _commanded(self, memory: TensorDictBase) -> Tensor | None:
        """Masks ``[N, J + K + 3]`` of what is commanded; None where all keyframes are whole."""
        return self.masks.table[memory["parts"]] if self.partial else None

    def _wanted(self, memory: TensorDictBase) -> GeneralizedState:
        """The motion, or the line between authored keyframes."""
        authored, frame = memory["authored"][:, None], self.table.state(memory["frame"])
        pairs = zip(self.line.state(self.line.way(memory)), frame, strict=True)
        return GeneralizedState(*(torch.where(authored, ours, theirs) for ours, theirs in pairs))

    def _leeway(self, memory: TensorDictBase) -> Tensor:
        """How far off a robot may be (m): an authored keyframe may be out of reach in its time.

        A robot that is sent where it cannot be in time is left behind further with every command.
        """
        before, after = (self.table.points(memory[key])[:, 0] for key in ("before", "goal"))
        way = (before - after).norm(dim=-1)
        way = torch.where(self.chain_rows.roams[self.chain_rows.chain(memory["goal"])], _BEHIND, way)
        return 0.8 + memory["authored"] * torch.where(way > 1.0, way, 0.0)


def _keypoints(pose: GeneralizedState, places: Tensor) -> TensorDict:
    """Poses ``[n]`` with keypoints, as functions of evaluation take them; all have the root's orientation."""
    quat = pose.root_quat_w[:, None].expand(-1, places.shape[1], -1)
    entries = {"keypoint_pos_w": places, "keypoint_quat_w": quat, "joint_pos": pose.joint_pos}
    return TensorDict(entries, [len(places)], device=places.device)
