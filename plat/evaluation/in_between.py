"""In-between motion: what a dense tracker is shown on its way to a sparse keyframe."""

from collections.abc import Mapping

import torch
from tensordict import NestedKey, TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Composite, Unbounded
from torchrl.envs import Transform

from plat.envs.goals import robot_centric_goal
from plat.envs.state import GeneralizedState
from plat.envs.transforms.base import ObservationTransform, check_entries
from plat.evaluation.names import Interface
from plat.motions.library import MotionLibrary
from plat.robots.kinematics import ForwardKinematics
from plat.rotations import quat_conjugate, quat_from_rotvec, quat_multiply, quat_to_rotvec
from plat.spec.observation import entry_shapes

__all__ = ["INTERFACES", "InBetween", "Interface", "Plan", "PlannedGoal"]

INTERFACES: tuple[Interface, ...] = ("next-frame", "line", "cascade")
"""All interfaces of :data:`plat.evaluation.names.Interface`."""

_BLEND = 0.4  # seconds in which a cascade's velocity turns from the robot's to the mean one
_PLAN: dict[NestedKey, torch.dtype] = {("plan", "start"): torch.float32, ("plan", "length"): torch.int64}


class Plan(Transform):
    """Transform that keeps where a robot was when its command was issued, and for how long the command is.

    In a hold, where the pose that has just arrived is due again in the next step, that pose at rest takes the robot's
    place: a motion from where the robot is would be there within a step, at many times its speed.

    Writes ``("plan", "start")``, the packed :class:`plat.envs.state.GeneralizedState`, and ``("plan", "length")``
    ``[1]``, control steps. Put it after :class:`plat.envs.transforms.KeyframeCommand`.

    Args:
        library: motions; gives the number of joints.
    """

    def __init__(self, library: MotionLibrary):
        super().__init__(out_keys=list(_PLAN))
        self._library = library
        self._width = 13 + 2 * library.robot.num_joints

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        issued = next_tensordict["command", "arrived"]
        begun = _begun(next_tensordict)
        before, now = (self._at_rest(entries["command", "target_frame"]) for entries in (tensordict, next_tensordict))
        same = (before - now).abs().amax(-1, keepdim=True) < 1e-5  # resampled, it is not so to the last bit
        held = same & (next_tensordict["command", "steps_left"] == 1)
        begun["plan", "start"] = torch.where(held, now, begun["plan", "start"])
        for key, value in begun.items():
            next_tensordict[key] = torch.where(issued, value, tensordict[key])
        return next_tensordict

    def _at_rest(self, frame: Tensor) -> Tensor:
        """Return the poses of library rows ``[N]`` as packed states without velocity."""
        poses = self._library.qpos(frame)
        return torch.nn.functional.pad(poses, (0, self._width - poses.shape[-1]))

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        for key, value in _begun(tensordict_reset).items():
            tensordict_reset[key] = value
        return tensordict_reset

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Add the plan's entries."""
        check_entries("Plan", [("command", "steps_left"), ("state", "root_pos_w")], observation_spec)
        count, device = observation_spec.shape, observation_spec.device
        entries = {
            "start": Unbounded((*count, self._width), device=device),
            "length": Unbounded((*count, 1), dtype=torch.int64, device=device),
        }
        observation_spec["plan"] = Composite(entries, shape=count, device=device)
        return observation_spec


def _begun(tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
    start = GeneralizedState.from_entries(tensordict).pack()
    return {("plan", "start"): start, ("plan", "length"): tensordict["command", "steps_left"]}


class InBetween:
    """In-between motion from where a robot was to its keyframe.

    The line goes there at constant velocity. The cascade starts with the robot's velocity, and turns to that of the
    line within 0.4 s. Both rest at the keyframe, and in a hold they are the keyframe. They are made from what a robot
    knows: its own state and the command.

    Args:
        library: motions that the keyframes are taken from.
        interface: ``"line"`` or ``"cascade"``.
        bodies: whose poses are computed, by default the keypoints.
    """

    in_keys: tuple[NestedKey, ...] = (("command", "target_frame"), ("command", "steps_left"), *_PLAN)

    def __init__(self, library: MotionLibrary, interface: Interface, bodies: tuple[str, ...] | None = None):
        self._library = library
        self._carries_velocity = interface == "cascade"
        self._kinematics = ForwardKinematics(library.robot, bodies)

    def poses(self, tensordict: TensorDictBase, ahead: Tensor) -> TensorDict:
        """Return poses ``[N, *F]`` some frames ``[*F]`` ahead.

        Returns:
            ``joint_pos``, ``keypoint_pos`` and ``keypoint_quat`` as in :meth:`plat.motions.MotionLibrary.poses`, but of
            the chosen bodies; ``root_pos`` and ``root_quat``.
        """
        root_pos, root_quat, joint_pos = self._coordinates(tensordict, ahead)
        keypoint_pos, keypoint_quat = self._kinematics(root_pos, root_quat, joint_pos)
        return TensorDict(
            {
                "joint_pos": joint_pos,
                "keypoint_pos": keypoint_pos,
                "keypoint_quat": keypoint_quat,
                "root_pos": root_pos,
                "root_quat": root_quat,
            },
            joint_pos.shape[:-1],
        )

    def velocities(self, tensordict: TensorDictBase, ahead: Tensor) -> dict[str, Tensor]:
        """Return ``joint_vel``, ``root_lin_vel_w`` and ``root_ang_vel_w`` ``[N, *F, ...]``, a frame's difference."""
        now, then = (self._coordinates(tensordict, frames) for frames in (ahead, ahead + 1))
        dt = self._library.dt
        return {
            "joint_vel": (then[2] - now[2]) / dt,
            "root_lin_vel_w": (then[0] - now[0]) / dt,
            "root_ang_vel_w": quat_to_rotvec(quat_multiply(then[1], quat_conjugate(now[1]))) / dt,
        }

    def _coordinates(self, tensordict: TensorDictBase, ahead: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        start = GeneralizedState.unpack(tensordict["plan", "start"].view(-1, *[1] * ahead.ndim, self._width))
        target = self._library.poses(tensordict["command", "target_frame"]).view(-1, *[1] * ahead.ndim)
        length = tensordict["plan", "length"].view(-1, *[1] * ahead.ndim)
        step = length - tensordict["command", "steps_left"].view_as(length) + ahead
        duration = (length * self._library.dt)[..., None].float()
        time = (step * self._library.dt)[..., None].float().clamp_min(0.0).minimum(duration)
        blend = duration.clamp_max(_BLEND)
        # derivative 1 at the start, and 0 with derivative 0 from the end of the blend on
        carried = time * (1 - time / blend).clamp_min(0.0).square() * self._carries_velocity

        def between(offset: Tensor, velocity: Tensor) -> Tensor:
            mean = offset / duration
            return mean * time + (velocity - mean) * carried

        turn = quat_to_rotvec(quat_multiply(quat_conjugate(start.root_quat_w), target["keypoint_quat"][..., 0, :]))
        root_pos = start.root_pos_w + between(
            target["keypoint_pos"][..., 0, :] - start.root_pos_w, start.root_lin_vel_w
        )
        root_quat = quat_multiply(start.root_quat_w, quat_from_rotvec(between(turn, start.root_ang_vel_b)))
        joint_pos = start.joint_pos + between(target["joint_pos"] - start.joint_pos, start.joint_vel)
        return root_pos, root_quat, joint_pos

    @property
    def _width(self) -> int:
        return 13 + 2 * self._library.robot.num_joints


class PlannedGoal(ObservationTransform):
    """Transform that adds an in-between motion ``k`` frames ahead as a goal, for plat's own dense trackers.

    Args:
        library: motions.
        interface: of the in-between motion.
        group: name of the goal group.
        ahead: number of frames k.
    """

    def __init__(self, library: MotionLibrary, interface: Interface, group: str = "goal", ahead: int = 1):
        super().__init__(
            in_keys=[*InBetween.in_keys, ("estimate", "root_pos_w"), ("estimate", "root_quat_w")],
            out_shapes={(group, key): shape for key, shape in entry_shapes("goal", library.robot).items()},
        )
        self._motion = InBetween(library, interface)
        self._group = group
        self._ahead = torch.tensor(ahead, device=library.device)

    @classmethod
    def of_groups(cls, library: MotionLibrary, goals: Mapping[str, int], interface: Interface) -> list[Transform]:
        """Return :class:`Plan` and a transform for each group, given by name with its number of frames ahead."""
        return [Plan(library), *(cls(library, interface, group, ahead) for group, ahead in goals.items())]

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        target = self._motion.poses(tensordict, self._ahead)
        goal = robot_centric_goal(target, tensordict["estimate", "root_pos_w"], tensordict["estimate", "root_quat_w"])
        return {(self._group, key): value for key, value in goal.items()}
