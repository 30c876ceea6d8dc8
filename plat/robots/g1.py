"""The Unitree G1 with 29 joints."""

from plat.robots.mjcf import Capsule
from plat.robots.robot import Robot

__all__ = ["G1"]

# x of the two ends and y (m, ankle_roll frame) of seven capsules that follow the outline of Unitree's description:
# a sole from -0.06 to 0.14 m, widest at the ball of the foot
_SOLE_OUTLINE = (
    (0.050, 0.100, -0.026),
    (-0.044, 0.123, -0.018),
    (-0.052, 0.130, -0.010),
    (-0.054, 0.132, 0.000),
    (-0.052, 0.130, 0.010),
    (-0.044, 0.123, 0.018),
    (0.050, 0.100, 0.026),
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
    sole_capsules=tuple(Capsule((back, y, -0.025), (front, y, -0.025)) for back, front, y in _SOLE_OUTLINE),
)
"""Unitree G1 with 29 joints."""
