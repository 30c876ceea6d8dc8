"""Robot description: model file, default pose, keypoints, feet and motors of a humanoid."""

import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
import torch
from torch import Tensor

from plat.bounds import NotEmpty, Range, check_value
from plat.errors import ConfigError, RobotError
from plat.json_file import short
from plat.robots.contact_geoms import touches_floor
from plat.robots.contacts import FootContacts
from plat.robots.mjcf import (
    Capsule,
    add_floor,
    add_foot_counts,
    asset_path,
    check_model,
    compile_spec,
    leave_out_floors,
    read_spec,
    replace_soles,
    saved_model,
)
from plat.robots.motors import adopt_limits
from plat.words import perhaps

__all__ = ["FootContacts", "Robot", "without_side"]

# A default pose may be this far (rad) beyond a joint's limits: a stance at the stop, rounded. Degrees are farther.
_SLACK = 0.05
# Bodies that are no further than this from side to side (m) are both in the middle.
_ASIDE = 0.01
# Higher (m) no root of a humanoid is: these are centimeters.
_HIGHEST = 5.0

_KINDS: dict[str, Any] = {
    "asset": str,
    "root_height": Annotated[float, Range(0, _HIGHEST, above=True)],
    "default_pose": dict,
    "keypoints": Annotated[tuple[str, ...], NotEmpty()],
    "anchor": str,
    "end_effectors": tuple[str, ...],
    "feet": tuple[str, str],
    "sole_capsules": tuple[Capsule, ...],
}


@dataclass(frozen=True)
class Robot:
    """Description of a position-controlled humanoid: its model file and the names that the task uses.

    Args:
        name: identifies the robot in caches, checkpoints and error messages.
        asset: MJCF description: a file name in ``plat/robots/assets``, or a path elsewhere. It has one free joint
            first, then hinges, and one position actuator a hinge in their order. Each hinge has a body of its own,
            whose origin it goes through, a ``range`` and no ``ref``; each actuator has a ``forcerange``, or its joint
            an ``actuatorfrcrange``. Targets are not clipped, see :attr:`notes`. Environments read the contact sensors
            ``left_foot_contact`` and ``right_foot_contact`` (``data="found force"``), ``ground_contact`` and
            ``self_contact`` (``data="found"``).
        root_height: height of the root above the floor in the default pose (m).
        default_pose: joint name to angle (rad); joints that are not named are 0.
        keypoints: bodies whose positions a keyframe commands; the first one is the root body.
        anchor: the keypoint whose pose tracking is measured against.
        end_effectors: the keypoints whose height error can terminate an episode.
        feet: the bodies of the left and right foot; keypoints as well.
        sole_capsules: contact geometry of a foot that ``feet="capsules"`` uses in place of the asset's own.

    Raises:
        RobotError: for a field of another kind or out of its range; by :meth:`model`, when a name is not in the model.

    >>> from plat.robots import G1
    >>> G1.num_joints, len(G1.keypoints), round(G1.model().body_mass.sum(), 3)
    (29, 14, np.float64(33.341))
    """

    name: str
    asset: str
    root_height: float
    default_pose: dict[str, float]
    keypoints: tuple[str, ...]
    anchor: str
    end_effectors: tuple[str, ...]
    feet: tuple[str, str]
    sole_capsules: tuple[Capsule, ...] = ()

    def __post_init__(self) -> None:
        """Check kinds and ranges of the fields."""
        if not isinstance(self.name, str) or not self.name.strip():
            raise RobotError(f"robot: name is {short(self.name)}, expected a text that is not empty")
        try:
            for field, kind in _KINDS.items():
                check_value(f"robot {self.name!r}: {field}", getattr(self, field), kind)
            for joint, angle in self.default_pose.items():
                check_value(f"robot {self.name!r}: default_pose: {joint!r}", angle, float)
        except ConfigError as error:
            raise RobotError(str(error)) from None
        if "\0" in self.asset:
            raise RobotError(f"robot {self.name!r}: asset {short(self.asset)} holds a null byte, expected a path")

    def check(self) -> "Robot":
        """Check every field against the model, and return the robot.

        Raises:
            RobotError: naming the field, and what would be right.

        >>> from plat.robots import G1
        >>> G1.check() is G1
        True
        """
        if self.feet[0] == self.feet[1]:
            raise RobotError(f"robot {self.name!r}: feet: {self.feet[0]!r} twice, expected the left and the right foot")
        _ = self.default_joint_pos, self.notes
        left, right = self.feet
        if self._leftward(right) > self._leftward(left) + _ASIDE:
            raise RobotError(
                f"robot {self.name!r}: feet: {left!r} is to the right of {right!r} in the default pose, expected the "
                "left foot first, in a robot that faces along x"
            )
        return self

    def spec(self, feet: FootContacts = "spheres") -> mujoco.MjSpec:
        """Return the editable description with a floor.

        Args:
            feet: contact geometry of the soles: ``"spheres"`` (the asset's own) or ``"capsules"``
                (:attr:`sole_capsules`: slower, and closer to the outline).

        Raises:
            RobotError: when the asset cannot be read, or the robot has no capsules.
        """
        if feet not in ("spheres", "capsules"):
            raise RobotError(f"feet: {feet!r}, expected 'spheres' or 'capsules'")
        if feet == "capsules" and not self.sole_capsules:
            raise RobotError(f"robot {self.name!r} has no sole_capsules, expected feet 'spheres'")
        spec, _ = self._read()
        add_floor(spec)
        if feet == "capsules":
            replace_soles(spec, self.feet, self.sole_capsules)
        return spec

    def model(
        self, feet: FootContacts = "spheres", timestep: float | None = None, *, foot_counts: bool = False
    ) -> mujoco.MjModel:
        """Return a compiled model of the caller's own.

        Args:
            feet: as for :meth:`spec`.
            timestep: physics step (s); None for the asset's.
            foot_counts: add the sensors ``left_foot_count`` and ``right_foot_count``, which environments read.

        Raises:
            RobotError: when the asset cannot be used, a name is not in it, or a body that has to be a keypoint is none.
        """
        spec = self.spec(feet)
        if foot_counts:
            add_foot_counts(spec)
        model = compile_spec(spec, self.asset, self.name)
        check_model(model, self.name, {"keypoints": self.keypoints, "feet": self.feet}, self.asset)
        if doubled := [body for index, body in enumerate(self.keypoints) if body in self.keypoints[:index]]:
            raise RobotError(f"robot {self.name!r}: keypoints: {doubled[0]!r} stands there twice")
        named = {"anchor": (self.anchor,), "end_effectors": self.end_effectors, "feet": self.feet}
        for field, bodies in named.items():
            if others := [body for body in bodies if body not in self.keypoints]:
                near = perhaps(others[0], self.keypoints)
                raise RobotError(f"robot {self.name!r}: {field}: {others[0]!r} is not among its keypoints{near}")
        if timestep is not None:
            model.opt.timestep = timestep
        return model

    def compiled(self) -> bytes:
        """Return the compiled model as MuJoCo saves it, with all that its description includes."""
        return saved_model(self.shared_model)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Return what is read otherwise than the MJCF description says, a line each.

        A ``ctrlrange`` or ``inheritrange`` that reaches a joint's limits is left out: a policy's targets may lie beyond
        them, in simulation and on a robot. So is a floor: plat adds its own.

        >>> from plat.robots import G1
        >>> G1.notes
        ()
        """
        return self._read()[1]

    def _read(self) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
        """Return the description in the form that plat computes with, without a floor, and :attr:`notes`."""
        spec = read_spec(self.asset, self.name)
        return spec, (*adopt_limits(spec, self._where), *leave_out_floors(spec, self._where))

    @property
    def _where(self) -> str:
        return f"robot {self.name!r}: {self.asset}"

    @property
    def asset_path(self) -> Path:
        """Return the path of the MJCF description."""
        return asset_path(self.asset)

    def with_asset_in(self, folder: Path) -> "Robot":
        """Return the robot with a relative asset resolved in a folder, and plat's own where that has none."""
        beside = folder / self.asset
        if os.path.isfile(beside):  # Path's own raises for a name that is too long
            return replace(self, asset=str(beside.resolve()))
        path = self.asset_path
        return self if path.is_absolute() else replace(self, asset=str((folder / path).resolve()))

    @cached_property
    def shared_model(self) -> mujoco.MjModel:
        """Return :meth:`model`, compiled once and shared by read-only users."""
        return self.model()

    def sole_geoms(self, model: mujoco.MjModel) -> np.ndarray:
        """Return the indices of the geoms that the left and right foot touch the floor with ``[2, P]``.

        Args:
            model: of this robot.

        Raises:
            RobotError: when a foot has none, or the other one has more.

        >>> from plat.robots import G1
        >>> G1.sole_geoms(G1.model("capsules")).shape
        (2, 7)
        """
        touches = touches_floor(model)
        soles = [np.flatnonzero(touches & (model.geom_bodyid == model.body(foot).id)) for foot in self.feet]
        counts = [len(geoms) for geoms in soles]
        if len(set(counts)) > 1 or not all(counts):
            told = " and ".join(f"{count} on {foot!r}" for count, foot in zip(counts, self.feet, strict=True))
            raise RobotError(f"robot {self.name!r}: contact geoms: {told}; expected as many on each foot, at least one")
        return np.stack(soles)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Return hinge joints in the order of every joint vector, without the ``_joint`` ending."""
        model = self.shared_model
        return tuple(model.joint(i).name.removesuffix("_joint") for i in range(1, model.njnt))

    @property
    def num_joints(self) -> int:
        """Return the number of hinge joints J."""
        return len(self.joint_names)

    @cached_property
    def default_joint_pos(self) -> Tensor:
        """Return the joint angles of the default pose ``[J]`` (rad)."""
        if unknown := sorted(set(self.default_pose) - set(self.joint_names)):
            near = perhaps(unknown[0], self.joint_names)
            raise RobotError(f"robot {self.name!r}: default_pose names no joint of the model: {short(unknown)}{near}")
        pose = torch.tensor([self.default_pose.get(name, 0.0) for name in self.joint_names])
        low, high = self.joint_range.unbind(-1)
        beyond = (pose < low - _SLACK) | (pose > high + _SLACK)
        if beyond.any():
            index = int(beyond.nonzero()[0])
            raise RobotError(
                f"robot {self.name!r}: default_pose: {self.joint_names[index]!r} at {pose[index]:g} rad, "
                f"expected an angle within its limits, {low[index]:g} to {high[index]:g} rad"
            )
        return pose

    @cached_property
    def default_qpos(self) -> np.ndarray:
        """Return the MuJoCo position vector ``[7 + J]`` of the default pose, standing at the origin."""
        root = [0.0, 0.0, self.root_height, 1.0, 0.0, 0.0, 0.0]
        return np.concatenate((root, self.default_joint_pos.double().numpy()))

    @cached_property
    def stiffness(self) -> Tensor:
        """Return the proportional gains kp ``[J]`` (N m / rad)."""
        return torch.from_numpy(self.shared_model.actuator_gainprm[:, 0]).float()

    @cached_property
    def damping(self) -> Tensor:
        """Return the derivative gains kd ``[J]`` (N m s / rad)."""
        return torch.from_numpy(-self.shared_model.actuator_biasprm[:, 2]).float()

    @cached_property
    def effort_limit(self) -> Tensor:
        """Return the largest joint torque ``[J]`` (N m)."""
        return torch.from_numpy(self.shared_model.actuator_forcerange[:, 1]).float()

    @cached_property
    def joint_range(self) -> Tensor:
        """Return lower and upper joint limits ``[J, 2]`` (rad)."""
        return torch.from_numpy(self.shared_model.jnt_range[1:]).float()

    @cached_property
    def action_scale(self) -> Tensor:
        """Return the joint angle per unit of action ``[J]`` (rad): ``0.25 * effort_limit / kp``.

        One unit of action asks for a quarter of the motor's torque, whatever the motor.
        """
        return 0.25 * self.effort_limit / self.stiffness

    def depth(self, joint: str) -> int:
        """Return the number of bodies from the root, excluded, to the body that a joint moves, included.

        >>> from plat.robots import G1
        >>> [G1.depth(joint) for joint in ("left_hip_pitch", "left_knee", "waist_yaw")]
        [1, 4, 1]
        """
        return len(self._to_root(int(self.shared_model.jnt_bodyid[1 + self.joint_names.index(joint)])))

    def _to_root(self, body: int) -> list[int]:
        """Return the bodies from one up to the root, without the root; MuJoCo's index of the root is 1."""
        path = []
        while body > 1:
            path.append(body)
            body = int(self.shared_model.body_parentid[body])
        return path

    def joints_to(self, body: str) -> list[int]:
        """Return the indices of the joints between the root and a body, the nearest to the root first.

        >>> from plat.robots import G1
        >>> [G1.joint_names[joint] for joint in G1.joints_to("left_knee_link")]
        ['left_hip_pitch', 'left_hip_roll', 'left_hip_yaw', 'left_knee']
        """
        model = self.shared_model
        bodies = self._to_root(model.body(body).id)
        return [joint for joint in range(self.num_joints) if model.jnt_bodyid[1 + joint] in bodies]

    @cached_property
    def leg_joints(self) -> list[int]:
        """Return the indices of the joints between the root and the feet.

        >>> from plat.robots import G1
        >>> [G1.joint_names[joint] for joint in G1.leg_joints[:3]], len(G1.leg_joints)
        (['left_hip_pitch', 'left_hip_roll', 'left_hip_yaw'], 12)
        """
        return sorted({joint for foot in self.feet for joint in self.joints_to(foot)})

    @property
    def anchor_index(self) -> int:
        """Return the index of the anchor among the keypoints."""
        return self.keypoints.index(self.anchor)

    @cached_property
    def hands(self) -> tuple[str, str]:
        """Return the bodies of the left and right hand: the end effectors that are no feet.

        The left one is that on the left side in the default pose; where both are in the middle, the first of them.
        Two empty names for a robot that has not two hands.

        >>> from plat.robots import G1
        >>> G1.hands
        ('left_wrist_yaw_link', 'right_wrist_yaw_link')
        """
        hands = [body for body in self.end_effectors if body not in self.feet]
        if len(hands) != 2:
            return ("", "")
        one, other = hands
        return (other, one) if self._leftward(other) > self._leftward(one) + _ASIDE else (one, other)

    def _leftward(self, body: str) -> float:
        """Return how far to the left of the root a body is in the default pose (m)."""
        data = mujoco.MjData(self.shared_model)
        data.qpos[:] = self.default_qpos
        mujoco.mj_kinematics(self.shared_model, data)
        return float(data.body(body).xpos[1])

    @property
    def end_effector_indices(self) -> list[int]:
        """Return the indices of the end effectors among the keypoints."""
        return [self.keypoints.index(body) for body in self.end_effectors]


def without_side(name: str) -> str:
    """Return the name of a joint without ``left_`` or ``right_``.

    >>> without_side("left_knee"), without_side("waist_yaw")
    ('knee', 'waist_yaw')
    """
    return name.removeprefix("left_").removeprefix("right_")
