"""From the motion of a human to where a robot's bodies should be: the human's limb directions, the robot's lengths."""

from dataclasses import dataclass, field

import numpy as np

from plat.motions.retargeting.geometry import RobotGeometry
from plat.motions.retargeting.human import Human
from plat.motions.retargeting.planted_feet import contact_weight, hold, levelling, pointing
from plat.motions.retargeting.skeletons import SIDES, SkeletonMap
from plat.rotations_np import axis_rotation

__all__ = ["Targets", "robot_targets"]

# Percentile of the heights of ankles and toes over a clip that is taken for their height on the ground.
_GROUND_PERCENTILE = 5.0
# Heights of who stands are no more: of the toe over the body's lowest joint (legs), of the ankle over the toe (feet).
_TOE_HEIGHT, _ANKLE_HEIGHT = 0.05, 0.75
# A foot that is nearly flat in contact is made flat: pitch below this is taken away (rad).
_FLAT_PITCH = 0.09
# Sines of slopes between which a foot that lies becomes one that may stand: of the shin, and of a foot on its toes; and
# that of the foot from which on it does not stand, and beyond which surely not.
_SHIN_UP, _ON_TOES, _TOE_UP = (0.15, 0.35), (0.3, 0.6), (0.3, 0.6)
# No shoulder turns further back than this (rad).
_BEHIND = 2.2


@dataclass(frozen=True)
class Targets:
    """Where bodies of the robot should be over T frames, in a world with the ground at height 0.

    Attributes:
        positions: of pelvis, knees, ankles, elbows and wrists, role to ``[T, 3]`` (m).
        rotations: of pelvis, torso and ankles, role to ``[T, 3, 3]`` (body to world; x forward, y left, z up).
        contact: role of an ankle to how sure it is that this foot stands ``[T]``, in 0..1.
        clearance: role of an ankle to the height of the lowest point of its sole ``[T]`` (m).
        posture: name of a joint of the shoulders to its approximate angle ``[T]`` (rad): says which of the poses
            that put the elbow in its place is meant.
    """

    positions: dict[str, np.ndarray] = field(default_factory=dict)
    rotations: dict[str, np.ndarray] = field(default_factory=dict)
    contact: dict[str, np.ndarray] = field(default_factory=dict)
    flat: dict[str, np.ndarray] = field(default_factory=dict)
    clearance: dict[str, np.ndarray] = field(default_factory=dict)
    posture: dict[str, np.ndarray] = field(default_factory=dict)


def robot_targets(human: Human, skeleton: SkeletonMap, robot: RobotGeometry, fps: float) -> Targets:
    """Scale a human's motion to a robot.

    The path of the middle of the hips is scaled by the ratio of leg lengths. From there on every limb keeps its
    direction and takes the robot's length. Feet in contact are put flat or on their toes on the ground, and held in
    place. Feet in the air keep the human's clearance, scaled.

    Args:
        human: what to imitate.
        skeleton: gives the pitch of pelvis and torso.
        robot: lengths.
        fps: frames a second.
    """
    at, scale = human.positions, robot.leg / human.leg
    ground = _ground(human)
    pelvis_rot = _frame(at["left_hip"] - at["right_hip"], at["spine"] - at["hips"], skeleton.pelvis_pitch)
    torso_rot = _frame(at["left_shoulder"] - at["right_shoulder"], at["neck"] - at["chest"], skeleton.torso_pitch)
    hips = 0.5 * (at["left_hip"] + at["right_hip"]) - [0, 0, ground["ankle"]]
    pelvis = scale * hips + [0, 0, robot.ankle_height] - pelvis_rot @ (robot.hip * [1, 0, 1])
    torso = pelvis + pelvis_rot @ robot.torso
    targets = Targets({"pelvis": pelvis}, {"pelvis": pelvis_rot, "torso": torso_rot})
    for side, mirror in zip(SIDES, ([1, 1, 1], [1, -1, 1]), strict=True):
        leg = _limb(human, side, ("hip", "knee", "ankle"), (robot.thigh, robot.shin))
        arm = _limb(human, side, ("shoulder", "elbow", "wrist"), (robot.upper_arm, robot.forearm))
        pitch, roll = _shoulder_angles(np.swapaxes(torso_rot, 1, 2) @ _direction(arm[0])[..., None])
        targets.posture.update({f"{side}_shoulder_pitch": pitch, f"{side}_shoulder_roll": roll})
        leg += pelvis + pelvis_rot @ (robot.hip * mirror)
        arm += torso + torso_rot @ (robot.shoulder * mirror)
        targets.positions.update({f"{side}_knee": leg[0], f"{side}_elbow": arm[0], f"{side}_wrist": arm[1]})
        _plant(targets, human, side, leg[1], ground, robot, fps)
    return targets


def _ground(human: Human) -> dict[str, float]:
    """Return the heights of ankle and toe of a foot that stands (m), also where none does: as of who lies or sits."""
    at = human.positions
    lowest = float(np.percentile(np.min([place[:, 2] for place in at.values()], 0), _GROUND_PERCENTILE))
    foot = float(np.mean([np.linalg.norm(at[f"{side}_toe"] - at[f"{side}_ankle"], axis=1) for side in SIDES]))
    ankle, toe = (
        float(np.percentile([at[f"{side}_{joint}"][:, 2] for side in SIDES], _GROUND_PERCENTILE))
        for joint in ("ankle", "toe")
    )
    toe = min(toe, lowest + _TOE_HEIGHT * human.leg)
    return {"ankle": min(ankle, toe + _ANKLE_HEIGHT * foot), "toe": toe}


def _limb(human: Human, side: str, joints: tuple[str, str, str], lengths: tuple[float, float]) -> np.ndarray:
    """Second and third joint of a limb as seen from the first, ``[2, T, 3]``."""
    start, middle, end = (human.positions[f"{side}_{joint}"] for joint in joints)
    first = lengths[0] * _direction(middle - start)
    return np.stack((first, first + lengths[1] * _direction(end - middle)))


def _shoulder_angles(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pitch and roll ``[T]`` that point a hanging arm in a direction ``[T, 3, 1]`` in the torso's frame."""
    x, y, z = direction[..., 0].T
    pitch = -np.arctan2(x, -z)
    # an arm that is up and a little behind came up in front
    return np.where(pitch > _BEHIND, pitch - 2 * np.pi, pitch), np.arcsin(np.clip(y, -1, 1))


def _plant(
    targets: Targets,
    human: Human,
    side: str,
    ankle: np.ndarray,
    ground: dict[str, float],
    robot: RobotGeometry,
    fps: float,
) -> None:
    """Add the targets of a foot: ``ankle`` ``[T, 3]`` is where limb directions alone would put it."""
    role, toe = f"{side}_ankle", human.positions[f"{side}_toe"]
    height = human.positions[role][:, 2] - ground["ankle"], toe[:, 2] - ground["toe"]
    contact = contact_weight(height[1], toe, fps) * _sole_down(human, side)
    clearance = robot.leg / human.leg * (1 - contact) * np.minimum(*height).clip(0)

    yaw, pitch, roll = _euler(_foot_frame(human, side, ground["ankle"] - ground["toe"]))
    yaw = np.unwrap(yaw)
    yaw = hold(yaw[:, None], contact * pointing(yaw, pitch, fps), fps)[:, 0]
    flat = levelling(contact, fps)
    pitch = pitch - flat * np.clip(pitch, -_FLAT_PITCH, _FLAT_PITCH)
    rotation = axis_rotation(2, yaw) @ axis_rotation(1, pitch) @ axis_rotation(0, (1 - flat) * roll)

    tip = rotation @ [robot.sole[:, 0].max(), 0, -robot.ankle_height]
    level = hold((ankle + tip)[:, :2], contact, fps) - tip[:, :2]
    lowest = (rotation @ robot.sole.T)[:, 2].min(1)
    targets.positions[role] = np.column_stack((level, clearance - lowest))
    targets.rotations[role] = rotation
    targets.contact[role] = contact
    targets.flat[role] = flat
    targets.clearance[role] = clearance


def _sole_down(human: Human, side: str) -> np.ndarray:
    """Return 0 where a foot lies, as of someone on the back or the side, and 1 where it can stand ``[T]``.

    It can below a shin that rises, or on its toes; and nowhere with the toe far over the ankle.
    """

    def rises(start: str, end: str, first: float, last: float) -> np.ndarray:
        line = human.positions[f"{side}_{end}"] - human.positions[f"{side}_{start}"]
        slope = line[:, 2] / np.linalg.norm(line, axis=1).clip(1e-9)
        return np.clip((slope - first) / (last - first), 0, 1)

    stands = np.maximum(rises("ankle", "knee", *_SHIN_UP), rises("toe", "ankle", *_ON_TOES))
    return stands * (1 - rises("ankle", "toe", *_TOE_UP))


def _foot_frame(human: Human, side: str, drop: float) -> np.ndarray:
    """Rotations ``[T, 3, 3]`` of the sole; ``drop`` is how much lower the toe is than the ankle when it is flat (m)."""
    knee, ankle, toe = (human.positions[f"{side}_{joint}"] for joint in ("knee", "ankle", "toe"))
    # The foot bends about an axis that is fixed in it and, on average, square to shin and foot. The average is needed
    # because a pointed foot lies in line with the shin.
    joint = human.rotations[f"{side}_ankle"]
    square = np.cross(knee - ankle, toe - ankle)
    left = joint @ _direction((np.swapaxes(joint, 1, 2) @ square[..., None]).mean((0, 2)))
    forward = _direction(toe - ankle)
    left = _direction(left - forward * (left * forward).sum(1, keepdims=True))
    slope = np.arcsin(np.clip(drop / np.linalg.norm(toe - ankle, axis=1).mean(), 0, 1))
    forward = np.cos(slope) * forward + np.sin(slope) * np.cross(forward, left)
    return np.stack((forward, left, np.cross(forward, left)), -1)


def _direction(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True).clip(1e-9)


def _frame(left: np.ndarray, up: np.ndarray, pitch: float) -> np.ndarray:
    """Rotations ``[T, 3, 3]`` whose y axis is ``left`` and whose z axis is near ``up``, leaned forward by ``pitch``."""
    left = _direction(left)
    forward = _direction(np.cross(left, up))
    return np.stack((forward, left, np.cross(forward, left)), -1) @ axis_rotation(1, np.deg2rad([pitch]))


def _euler(rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Yaw, pitch and roll ``[T]`` with ``rotation = Rz(yaw) Ry(pitch) Rx(roll)``."""
    yaw = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    pitch = np.arcsin(np.clip(-rotation[:, 2, 0], -1, 1))
    return yaw, pitch, np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])
