"""Mirror images of motions: left and right exchanged."""

from dataclasses import replace

from plat.motions.clip import MotionClip
from plat.robots import G1, Robot
from plat.robots.symmetry import MIRRORED_AXIS, joint_symmetry

__all__ = ["mirror_motion"]

_SUFFIX = "_mirrored"


def mirror_motion(clip: MotionClip, robot: Robot = G1) -> MotionClip:
    """Return a clip's mirror image: left and right limbs exchanged, in a world with y reversed.

    Which joints change places follows from their names, their signs from their axes. The mirror image of the mirror
    image is the clip.

    Raises:
        RobotError: when the robot has no such symmetry.
        MotionError: for a clip that is none of the robot's.

    >>> qpos = G1.default_qpos[None].repeat(2, 0)
    >>> qpos[:, 7 + G1.joint_names.index("left_hip_roll")] = 0.3
    >>> mirrored = mirror_motion(MotionClip("split", qpos, 30.0))
    >>> mirrored.qpos[0, 7 + G1.joint_names.index("right_hip_roll")]
    np.float64(-0.3)
    """
    clip.check(robot, least=1)  # a pose has a mirror image, too
    partner, sign = joint_symmetry(robot)
    qpos = clip.qpos.copy()
    qpos[:, 1] *= -1
    qpos[:, 4:7] *= MIRRORED_AXIS.astype(qpos.dtype)
    qpos[:, 7:] = clip.qpos[:, 7:][:, partner] * sign.astype(qpos.dtype)
    name = clip.name.removesuffix(_SUFFIX) if clip.name.endswith(_SUFFIX) else clip.name + _SUFFIX
    return replace(clip, name=name, qpos=qpos)
