"""Library of poses out of motion clips, found by words."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from plat.motions import MotionClip, MotionLibrary
from plat.robots.robot import Robot
from plat.rotations_np import heading_pitch_roll

__all__ = ["LibraryPose", "PoseLibrary"]

# A pose is kept where the robot is slower than before and after; of those, one in this many seconds.
_SPACING = 0.4
_MOST = 4000


@dataclass(frozen=True, eq=False)
class LibraryPose:
    """Pose of a clip.

    Args:
        clip: index of the clip in its library.
        name: of the clip.
        time: in the clip (s).
        words: what the pose is like.
        qpos: ``[7 + J]``.
    """

    clip: int
    name: str
    time: float
    words: tuple[str, ...]
    qpos: np.ndarray

    @property
    def label(self) -> str:
        """Return the pose in a line."""
        return f"{', '.join(self.words) or 'standing'} - {self.name} {self.time:.2f} s"


class PoseLibrary:
    """Poses in which clips come to rest or turn around, described by words.

    Args:
        poses: the poses.

    >>> from plat.motions import generate_motions
    >>> from plat.robots import G1
    >>> library = PoseLibrary.of(MotionLibrary.from_clips(generate_motions("val", seconds=8)), G1)
    >>> all("left" in pose.label for pose in library.search("left"))
    True
    """

    def __init__(self, poses: tuple[LibraryPose, ...]):
        self.poses = poses

    @classmethod
    def of(cls, library: MotionLibrary, robot: Robot) -> PoseLibrary:
        """Return the poses of all clips, at most 4000."""
        describe, poses = _Describer(robot), []
        for index, name in enumerate(library.clip_names):
            clip = library.clip(index)
            for row in _calm(clip):
                qpos = np.array(clip.qpos[row], dtype=np.float64)
                qpos[7:] = np.clip(qpos[7:], *robot.joint_range.double().numpy().T)
                poses.append(LibraryPose(index, name, row / clip.fps, describe(qpos), qpos))
                if len(poses) == _MOST:
                    return cls(tuple(poses))
        return cls(tuple(poses))

    def search(self, text: str) -> tuple[LibraryPose, ...]:
        """Return the poses whose label has all words of a text, in any order; all for an empty one."""
        words = text.lower().split()
        return tuple(pose for pose in self.poses if all(word in pose.label.lower() for word in words))


def _calm(clip: MotionClip) -> list[int]:
    """Return rows at which the joints are slowest among their neighbors, apart from each other."""
    joints = np.asarray(clip.qpos)[:, 7:]
    if len(joints) < 3:
        return [0]
    speed = np.linalg.norm(np.gradient(joints, axis=0), axis=1)
    lowest = [0, *(np.flatnonzero((speed[1:-1] <= speed[:-2]) & (speed[1:-1] < speed[2:])) + 1)]
    rows: list[int] = []
    for row in lowest:
        if not rows or row - rows[-1] >= _SPACING * clip.fps:
            rows.append(int(row))
    return rows


class _Describer:
    """Describer of poses: words for hands, feet, height and lean."""

    def __init__(self, robot: Robot):
        self._model = robot.shared_model
        self._data = mujoco.MjData(self._model)
        self._height = robot.root_height

    def __call__(self, qpos: np.ndarray) -> tuple[str, ...]:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        heading = heading_pitch_roll(qpos[3:7])[0]
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])

        def place(body: str) -> np.ndarray:
            away = self._data.body(body).xpos - qpos[:3]
            return np.array([*(turn @ away[:2]), away[2]])

        words = []
        shoulder = place("left_shoulder_roll_link")[2]
        for side, sign in (("left", 1), ("right", -1)):
            hand = place(f"{side}_wrist_yaw_link")
            if hand[2] > shoulder:
                words.append(f"{side} hand up")
            elif hand[0] > 0.33:
                words.append(f"{side} hand forward")
            elif sign * hand[1] > 0.38:
                words.append(f"{side} hand out")
        if qpos[2] < 0.72 * self._height:
            words.append("low")
        elif qpos[2] < 0.88 * self._height:
            words.append("crouched")
        pitch = heading_pitch_roll(self._data.body("torso_link").xquat)[1]
        if pitch > 0.35:
            words.append("bent forward")
        left, right = place("left_ankle_roll_link"), place("right_ankle_roll_link")
        if abs(left[0] - right[0]) > 0.22:
            words.append("stride")
        if left[1] - right[1] > 0.36:
            words.append("wide")
        if abs(left[2] - right[2]) > 0.06:
            words.append("left foot up" if left[2] > right[2] else "right foot up")
        return tuple(words)
