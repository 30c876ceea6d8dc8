"""Lengths of a robot's limbs and where they begin, measured in its zero pose."""

from dataclasses import dataclass

import mujoco
import numpy as np

from plat.errors import RobotError
from plat.robots.robot import Robot
from plat.robots.sole_points import touching_points

__all__ = ["TRACKED", "RobotGeometry"]

TRACKED = {
    "pelvis": "pelvis",
    "torso": "torso_link",
    **{
        f"{side}_{role}": f"{side}_{body}_link"
        for side in ("left", "right")
        for role, body in (("knee", "knee"), ("ankle", "ankle_roll"), ("elbow", "elbow"), ("wrist", "wrist_yaw"))
    },
}
"""Role to the body of the robot that has a target of position, orientation or both."""

# Bodies at which limbs begin.
_LIMBS = ("left_hip_roll_link", "left_shoulder_pitch_link", "left_shoulder_roll_link")


@dataclass(frozen=True)
class RobotGeometry:
    """What a human's limbs are scaled to, in m.

    Attributes:
        hip, shoulder: where legs and arms begin: the left hip in the pelvis' frame, the left shoulder in the torso's,
            ``[3]``. The right ones are their mirror images.
        torso: the torso's origin in the pelvis' frame ``[3]``.
        thigh, shin, upper_arm, forearm: lengths.
        sole: contact points of the left foot in the foot's frame, at the height of the sole ``[P, 3]``.
    """

    hip: np.ndarray
    shoulder: np.ndarray
    torso: np.ndarray
    thigh: float
    shin: float
    upper_arm: float
    forearm: float
    sole: np.ndarray

    @property
    def leg(self) -> float:
        """Return the length of thigh and shin together (m)."""
        return self.thigh + self.shin

    @property
    def ankle_height(self) -> float:
        """Return the height of the foot's frame above the floor when the foot is flat (m)."""
        return float(-self.sole[:, 2].min())

    @classmethod
    def of(cls, robot: Robot, what: str = "retargeting") -> "RobotGeometry":
        """Measure a robot that has the bodies of the G1.

        Args:
            robot: the robot.
            what: needs them; stands in the message.

        Raises:
            RobotError: naming bodies that are missing.

        >>> from plat.robots import G1
        >>> geometry = RobotGeometry.of(G1)
        >>> round(geometry.leg, 3), round(geometry.ankle_height, 3)
        (0.624, 0.035)
        """
        model = robot.shared_model
        known = {model.body(number).name for number in range(model.nbody)}
        if missing := sorted({*TRACKED.values(), *_LIMBS} - known):
            raise RobotError(f"robot {robot.name!r}: {what} needs the bodies of the G1, and it lacks {missing[:3]}")
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)

        def at(body: str) -> np.ndarray:
            return np.array(data.body(body).xpos - data.body("pelvis").xpos)

        def between(start: np.ndarray, end: str) -> float:
            return float(np.linalg.norm(at(end) - start))

        # arms turn about the axis of the shoulder's pitch joint: the point of it that is nearest to the next joint
        axis = data.body("left_shoulder_pitch_link").xmat.reshape(3, 3)[:, 1]
        to_roll = at("left_shoulder_roll_link") - at("left_shoulder_pitch_link")
        shoulder = at("left_shoulder_pitch_link") + axis * (axis @ to_roll)
        return cls(
            hip=at("left_hip_roll_link"),
            shoulder=shoulder - at("torso_link"),
            torso=at("torso_link"),
            thigh=between(at("left_hip_roll_link"), "left_knee_link"),
            shin=between(at("left_knee_link"), robot.feet[0]),
            upper_arm=between(shoulder, "left_elbow_link"),
            forearm=between(at("left_elbow_link"), "left_wrist_yaw_link"),
            sole=touching_points(robot, model)[0],
        )
