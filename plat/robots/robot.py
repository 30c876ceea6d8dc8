"""What plat needs to know about a humanoid, and the Unitree G1."""

from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from typing import Literal

import mujoco
import numpy as np
import torch
from torch import Tensor

from plat.errors import RobotError

__all__ = ["G1", "FootContacts", "Robot", "without_side"]

FootContacts = Literal["spheres", "capsules"]

# Seven capsules that follow the outline of the G1's sole: x of the two ends and y (m, ankle_roll frame). The
# outline is that of Unitree's description: a sole from -0.06 to 0.14 m, widest at the ball of the foot.
_SOLE_CAPSULES = (
    (0.050, 0.100, -0.026),
    (-0.044, 0.123, -0.018),
    (-0.052, 0.130, -0.010),
    (-0.054, 0.132, 0.000),
    (-0.052, 0.130, 0.010),
    (-0.044, 0.123, 0.018),
    (0.050, 0.100, 0.026),
)


@dataclass(frozen=True)
class Robot:
    """A position-controlled humanoid: its model file and the names that the task speaks of.

    Args:
        name: identifies the robot in caches, checkpoints and error messages.
        asset: file name of the MJCF description in ``plat/robots/assets``. It has one free joint called ``root``,
            one position actuator a joint in the order of the joints, and the sensors ``left_foot_contact``,
            ``right_foot_contact``, ``ground_contact`` and ``self_contact``.
        root_height: height of the root above the floor in the default pose (m).
        default_pose: joint name to angle (rad); joints that are not named are 0.
        keypoints: bodies whose positions a keyframe commands; the first one is the root body.
        anchor: the keypoint whose pose tracking is measured against.
        end_effectors: the keypoints whose height ends an episode when it is wrong.
        feet: the bodies of the left and right foot.

    Raises:
        RobotError: when a name is not in the model.

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

    def spec(self, feet: FootContacts = "spheres") -> mujoco.MjSpec:
        """Editable description with a floor.

        Args:
            feet: contact geometry of each sole: ``"spheres"`` (four, the fast one) or ``"capsules"`` (seven,
                the accurate one).
        """
        if feet not in ("spheres", "capsules"):
            raise RobotError(f"feet: {feet!r}, expected 'spheres' or 'capsules'")
        with resources.as_file(resources.files("plat.robots") / "assets" / self.asset) as path:
            spec = mujoco.MjSpec.from_file(str(path))
        spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.1])
        if feet == "capsules":
            for body_name in self.feet:
                _replace_sole(spec, body_name)
        return spec

    def model(self, feet: FootContacts = "spheres") -> mujoco.MjModel:
        """Compiled model of the caller's own; see :meth:`spec`."""
        model = self.spec(feet).compile()
        for body in (*self.keypoints, *self.feet):
            if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body) < 0:
                raise RobotError(f"robot {self.name!r}: body {body!r} is not in {self.asset}")
        return model

    @cached_property
    def shared_model(self) -> mujoco.MjModel:
        """:meth:`model`, compiled once for all who only read it."""
        return self.model()

    def sole_geoms(self, model: mujoco.MjModel) -> np.ndarray:
        """Numbers of the geoms that the left and right foot touch the floor with ``[2, P]``.

        Args:
            model: of this robot.

        >>> G1.sole_geoms(G1.model("capsules")).shape
        (2, 7)
        """
        touches = model.geom_contype != 0
        return np.stack([np.flatnonzero(touches & (model.geom_bodyid == model.body(foot).id)) for foot in self.feet])

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Hinge joints in the order of every joint vector, without the ``_joint`` ending."""
        model = self.shared_model
        return tuple(model.joint(i).name.removesuffix("_joint") for i in range(1, model.njnt))

    @property
    def num_joints(self) -> int:
        """Number of hinge joints J."""
        return len(self.joint_names)

    @cached_property
    def default_joint_pos(self) -> Tensor:
        """Joint angles of the default pose ``[J]`` (rad)."""
        unknown = set(self.default_pose) - set(self.joint_names)
        if unknown:
            raise RobotError(f"robot {self.name!r}: default_pose names no joint of the model: {sorted(unknown)}")
        return torch.tensor([self.default_pose.get(name, 0.0) for name in self.joint_names])

    @cached_property
    def default_qpos(self) -> np.ndarray:
        """MuJoCo position vector ``[7 + J]`` of the default pose, standing at the origin."""
        root = [0.0, 0.0, self.root_height, 1.0, 0.0, 0.0, 0.0]
        return np.concatenate((root, self.default_joint_pos.double().numpy()))

    @cached_property
    def stiffness(self) -> Tensor:
        """Proportional gains kp ``[J]`` (N m / rad)."""
        return torch.from_numpy(self.shared_model.actuator_gainprm[:, 0]).float()

    @cached_property
    def damping(self) -> Tensor:
        """Derivative gains kd ``[J]`` (N m s / rad)."""
        return torch.from_numpy(-self.shared_model.actuator_biasprm[:, 2]).float()

    @cached_property
    def effort_limit(self) -> Tensor:
        """Largest joint torque ``[J]`` (N m)."""
        return torch.from_numpy(self.shared_model.actuator_forcerange[:, 1]).float()

    @cached_property
    def joint_range(self) -> Tensor:
        """Lower and upper joint limits ``[J, 2]`` (rad)."""
        return torch.from_numpy(self.shared_model.jnt_range[1:]).float()

    @cached_property
    def action_scale(self) -> Tensor:
        """Joint angle per unit of action ``[J]`` (rad): ``0.25 * effort_limit / kp``.

        One unit of action asks for a quarter of the motor's torque, whatever the motor.
        """
        return 0.25 * self.effort_limit / self.stiffness

    @cached_property
    def leg_joints(self) -> list[int]:
        """Indices of the joints between the root and the feet.

        >>> [G1.joint_names[joint] for joint in G1.leg_joints[:3]], len(G1.leg_joints)
        (['left_hip_pitch', 'left_hip_roll', 'left_hip_yaw'], 12)
        """
        model = self.shared_model
        joints = []
        for foot in self.feet:
            body = model.body(foot).id
            while body != model.body(self.keypoints[0]).id:
                first, count = model.body_jntadr[body], model.body_jntnum[body]
                joints += [int(joint) - 1 for joint in range(first, first + count)]  # joint 0 is the free one
                body = model.body_parentid[body]
        return sorted(joints)

    @property
    def anchor_index(self) -> int:
        """Index of the anchor among the keypoints."""
        return self.keypoints.index(self.anchor)

    @property
    def end_effector_indices(self) -> list[int]:
        """Indices of the end effectors among the keypoints."""
        return [self.keypoints.index(body) for body in self.end_effectors]


def without_side(name: str) -> str:
    """Name of a joint without ``left_`` or ``right_``.

    >>> without_side("left_knee"), without_side("waist_yaw")
    ('knee', 'waist_yaw')
    """
    return name.removeprefix("left_").removeprefix("right_")


def _replace_sole(spec: mujoco.MjSpec, body_name: str) -> None:
    body = spec.body(body_name)
    spheres = [geom for geom in body.geoms if geom.classname.name == "foot"]
    side = body_name.split("_")[0]
    for sphere in spheres:
        spec.delete(sphere)
    for index, (x_back, x_front, y) in enumerate(_SOLE_CAPSULES, start=1):
        body.add_geom(
            spec.find_default("foot"),
            name=f"{side}_foot{index}_collision",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[0.01, 0, 0],
            fromto=[x_back, y, -0.025, x_front, y, -0.025],
        )


def _both_sides(*bodies: str) -> tuple[str, ...]:
    return tuple(f"{side}_{body}_link" for side in ("left", "right") for body in bodies)


G1 = Robot(
    name="g1",
    asset="g1.xml",
    root_height=0.76,
    default_pose={
        f"{side}_{joint}": angle * (sign if mirrored else 1.0)
        for side, sign in (("left", 1.0), ("right", -1.0))
        for joint, angle, mirrored in (
            ("hip_pitch", -0.312, False),
            ("knee", 0.669, False),
            ("ankle_pitch", -0.363, False),
            ("elbow", 0.6, False),
            ("shoulder_pitch", 0.2, False),
            ("shoulder_roll", 0.2, True),
        )
    },
    keypoints=(
        "pelvis",
        *_both_sides("hip_roll", "knee", "ankle_roll"),
        "torso_link",
        *_both_sides("shoulder_roll", "elbow", "wrist_yaw"),
    ),
    anchor="torso_link",
    end_effectors=_both_sides("ankle_roll", "wrist_yaw"),
    feet=("left_ankle_roll_link", "right_ankle_roll_link"),
)
"""Unitree G1 with 29 joints."""
