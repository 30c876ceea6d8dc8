"""Base class of the adapters for released trackers."""

from dataclasses import dataclass, fields, replace

import mujoco
import torch
from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import InitTracker, Transform

from plat.baselines.tracker_reference import PlannedReference, TrackerReference
from plat.evaluation.in_between import Plan
from plat.evaluation.names import Interface
from plat.motions.library import MotionLibrary
from plat.robots.robot import FootContacts, Robot
from plat.spec.observation import table

__all__ = ["Tracker", "tuned_robot"]


@dataclass(frozen=True)
class _TunedRobot(Robot):
    """Robot with its own motor settings; see :func:`tuned_robot`."""

    gains: tuple[tuple[float, float, float], ...] = ()

    def spec(self, feet: FootContacts = "spheres") -> mujoco.MjSpec:
        spec = super().spec(feet)
        for actuator, (stiffness, damping, effort) in zip(spec.actuators, self.gains, strict=True):
            actuator.gainprm[0] = stiffness
            actuator.biasprm[1:3] = -stiffness, -damping
            actuator.forcerange = [-effort, effort]
        return spec


def tuned_robot(robot: Robot, name: str, stiffness: Tensor, damping: Tensor, effort_limit: Tensor) -> Robot:
    """Return a robot with the motor settings that a policy was trained for.

    Args:
        robot: the original robot.
        name: of the new robot.
        stiffness: kp ``[J]`` (N m / rad).
        damping: kd ``[J]`` (N m s / rad).
        effort_limit: largest torque ``[J]`` (N m).

    >>> from plat.robots import G1
    >>> soft = tuned_robot(G1, "soft", 0.5 * G1.stiffness, G1.damping, G1.effort_limit)
    >>> torch.allclose(soft.stiffness, 0.5 * G1.stiffness)
    True
    """
    values = {field.name: getattr(robot, field.name) for field in fields(Robot)}
    gains = tuple(zip(stiffness.tolist(), damping.tolist(), effort_limit.tolist(), strict=True))
    return replace(_TunedRobot(**values, gains=gains), name=name)


class Tracker(TensorDictModuleBase):
    """Base of policies that track a dense reference and keep their own past actions.

    Reads the group ``"robot"``, the group of :class:`TrackerReference` and ``is_init`` (TorchRL's ``InitTracker``),
    and writes ``action`` in the parametrization of :class:`plat.envs.MotionTrackingEnv`. A subclass defines its
    network's observation, and the joint targets of its raw action.

    Args:
        robot: the robot that it drives, as :func:`tuned_robot` made it.
    """

    ahead: int | tuple[int, ...] = 1
    """Frames of the dense reference in the observation, counted from the current one."""

    def __init__(self, robot: Robot):
        super().__init__()
        self.in_keys: list[NestedKey] = ["robot", "tracker_reference", "is_init"]
        self.out_keys = ["action"]
        self.robot = robot
        self._memory: dict[str, Tensor] = {}

    def observe(self, library: MotionLibrary, dense: bool, interface: Interface = "next-frame") -> list[Transform]:
        """Return the transforms that add the tracker's inputs, see :func:`plat.evaluation.evaluate`.

        Args:
            library: motions of its :attr:`robot`.
            dense: show the reference itself; otherwise what ``interface`` says.
            interface: the commanded keyframe, at rest, in the place of every reference frame; or a motion that leads
                to it.
        """
        if not dense and interface != "next-frame":
            return [Plan(library), PlannedReference(library, interface, self.ahead), InitTracker()]
        if dense:
            reference = TrackerReference(library, ahead=self.ahead)
        else:
            instead = 0 if isinstance(self.ahead, int) else (0,) * len(self.ahead)
            reference = TrackerReference(library, ("command", "target_frame"), instead, velocities=False)
        return [reference, InitTracker()]

    stateful = True

    def references(self, library: MotionLibrary) -> list[Transform]:
        """Return the transforms that add the dense reference, see :class:`plat.modules.Teacher`.

        Args:
            library: motions of the environment, on its device.
        """
        return self.observe(library, dense=True)

    def labels(self) -> TensorDictModuleBase:
        """Return the module that writes its action to ``expert_action``.

        It takes its own labels for its past actions, also where a student has acted.
        """
        return _LabelingTracker(self)

    def remembered(self, name: str, like: Tensor, starting: Tensor) -> Tensor:
        """Return the value stored under a name: zeros for robots that are ``starting`` ``[N]``, else a copy."""
        kept = self._memory.get(name)
        if kept is None or kept.shape != like.shape:
            kept = torch.zeros_like(like)
        return torch.where(starting.view(-1, *[1] * (like.ndim - 1)), 0.0, kept)

    def remember(self, name: str, value: Tensor) -> None:
        """Store a value ``[N, ...]`` until the next step."""
        self._memory[name] = value

    def targets(self, tensordict: TensorDictBase, joint_pos: Tensor, starting: Tensor) -> Tensor:
        """Return joint targets ``[N, J]`` (rad) from measured angles ``joint_pos`` ``[N, J]`` (rad) and others."""
        raise NotImplementedError

    @torch.no_grad()
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ``action``."""
        measured = tensordict["robot"].copy()
        for entry in table().entries("robot"):
            if entry.scale != 1.0 and entry.name in measured:
                measured[entry.name] = entry.quantity(measured[entry.name])
        default = self.robot.default_joint_pos.to(measured["joint_pos"])
        seen = tensordict.copy().set("robot", measured)
        targets = self.targets(seen, measured["joint_pos"] + default, tensordict["is_init"][:, 0])
        tensordict["action"] = (targets - default) / self.robot.action_scale.to(targets)
        return tensordict


class _LabelingTracker(TensorDictModuleBase):
    """Tracker that writes ``expert_action`` and leaves ``action`` alone."""

    def __init__(self, tracker: Tracker):
        super().__init__()
        self.tracker = tracker
        self.in_keys, self.out_keys = tracker.in_keys, ["expert_action"]

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        return tensordict.set("expert_action", self.tracker(tensordict.select(*self.in_keys))["action"])
