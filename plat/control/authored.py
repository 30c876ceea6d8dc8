"""Authored keyframes: families of chains without a reference motion.

Recorded motion is not what a person draws. Each family here is a chain of five keyframes from the standing pose, then
a hold. The same seed gives the same chains.
"""

import logging
import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray

from plat.bounds import Count, Seed, check_robot, check_value
from plat.errors import KeyframeError
from plat.json_file import short
from plat.keyframes import Keyframe, KeyframeSequence, split_long_intervals, standing
from plat.keyframes.chain_families import AHEAD, FAMILY_TABLE, INSIDE, MIDDLE, RESTING, TRIES, ChainFamily
from plat.keyframes.chain_needs import lacking
from plat.keyframes.partial import hands_of
from plat.motions import MotionLibrary
from plat.motions.checks.collision import self_penetration
from plat.motions.generation.whole_body import WholeBody, has_six_joint_legs
from plat.robots import ForwardKinematics, Robot
from plat.rotations import quat_from_rotvec, quat_multiply
from plat.spec.parts import Parts
from plat.spec.proportions import in_proportion
from plat.spec.timing import Timing
from plat.words import counted

__all__ = ["FAMILIES", "Authored", "UndrawableError", "author", "resting_poses"]

Pose = NDArray[np.float64]
"""Root position (m, world), root quaternion ``wxyz`` and joint angles (rad): ``[7 + J]``."""

_JOINT_SPEED, _ROOT_SPEED, _PELVIS_HEIGHT = RESTING
_FOOT_OFF = 5e-3  # m
# Rounds of poses, and crouches, after which a robot is taken to have none of the kind. A G1 needs a few.
_MOST_ROUNDS, _MOST_CROUCHES = 200, 100
_SPARE = 3  # crouches that are solved ahead beyond those of a chain, for feet that come off

_LOGGER = logging.getLogger("plat.motions")

FAMILIES: dict[str, ChainFamily] = {name: family for name, family in FAMILY_TABLE.items() if family.scored}
"""The families that are scored, by name: ``far`` is out of reach within its 0.5 to 1 s, ``far3s`` is the same with 3 s.

``reach`` commands the positions of the hands, ``three_point`` those of hands and torso, which carries the head, and
``waypoint`` the root's horizontal position and orientation.
"""


class UndrawableError(KeyframeError):
    """Poses of a family that a robot cannot take, however often they are drawn."""


@dataclass(frozen=True)
class Authored:
    """Chain with the time that its last keyframe is held.

    Args:
        family: it is of.
        sequence: the chain.
        hold: seconds in the last keyframe.
        bodies: as in :class:`plat.keyframes.chain_families.ChainFamily`.
        number: among the chains of its family that a seed gives.
    """

    family: str
    sequence: KeyframeSequence
    hold: float
    bodies: float | None = None
    number: int = 0


def author(
    family: str, robot: Robot, count: int, seed: int, resting: Pose | None = None, timing: Timing | None = None
) -> list[Authored]:
    """Return chains of a family.

    Args:
        family: a name of :data:`FAMILIES`.
        robot: whose keyframes they are.
        count: number of chains.
        seed: draws them.
        resting: poses ``[M, 7 + J]`` for families that need them, see :func:`resting_poses`. A chain of ``poses`` has
            five; where there are fewer, they repeat, and a line says so.
        timing: of the policy that is to chase them; an interval beyond its longest command is split.

    Raises:
        KeyframeError: for another family, one that needs what is not there (see
            :func:`plat.keyframes.chain_needs.lacking`), and resting poses that are none of the robot's. It is an
            :class:`UndrawableError` where the robot can take none of its poses.
        RobotError: for what is no robot.
        ConfigError: for another argument that makes no sense.

    >>> from plat.robots import G1
    >>> chain = author("arms", G1, count=1, seed=0)[0]
    >>> len(chain.sequence), chain.hold, chain.sequence.keyframes[0].name
    (5, 3.0, 'arms 1')
    """
    check_robot(robot)
    check_value("author: count", count, Count)
    check_value("author: seed", seed, Seed)
    check_value("author: timing", timing, Timing | None)
    if not isinstance(family, str) or family not in FAMILIES:
        raise KeyframeError(f"authored family {short(family)}, expected one of {', '.join(FAMILIES)}")
    if resting is not None and np.shape(resting)[1:] != (7 + robot.num_joints,):
        expected = f"expected poses (M, {7 + robot.num_joints})"
        raise KeyframeError(f"author: resting has shape {np.shape(resting)}, {expected}, as resting_poses returns them")
    kind = FAMILIES[family]
    if lack := lacking(kind, robot, resting):
        raise KeyframeError(f"authored family {family!r} needs {lack}")
    if resting is not None and kind.resting and not kind.same and len(resting) < kind.length:
        found = counted(len(resting), "clip with a resting pose", "clips with a resting pose")
        _LOGGER.warning("authored family %r: %s, and %d keyframes a chain: poses repeat", family, found, kind.length)
    # a stream of its own for each family, so that a family is the same whatever others are asked for
    random = np.random.default_rng([seed, *family.encode()])
    draw = _Draw(robot, random, resting)
    timing = timing or Timing()
    commands = _commanded(kind, robot)
    chains = []
    for chain in range(count):
        try:
            poses = draw.chain(kind)
        except UndrawableError as error:
            raise UndrawableError(f"authored family {family!r} cannot be drawn: {error}") from None
        times = _times(random.uniform(*kind.interval, len(poses)), kind, timing)
        keyframes = [
            replace(Keyframe.from_qpos(time, pose, name=f"{family} {number}"), commands=commands)
            for number, (time, pose) in enumerate(zip(times, poses, strict=True), 1)
        ]
        chains.append(Authored(family, _sequence(robot, keyframes, timing), kind.hold, kind.bodies, chain))
    return chains


def _times(drawn: NDArray[np.float64], family: ChainFamily, timing: Timing) -> list[float]:
    """Return the times of keyframes (s) that come ``drawn`` seconds after each other, on control steps.

    Rounding leads no interval out of the family's range. A policy that knows a second would have a longer one split.
    """
    shortest, longest = (bound / timing.control_dt for bound in family.interval)
    fewest, most = math.ceil(shortest - 1e-6), math.floor(longest + 1e-6)
    steps = np.rint(drawn / timing.control_dt).clip(fewest, max(fewest, most))
    return [round(float(time), 6) for time in steps.cumsum() * timing.control_dt]


def resting_poses(library: MotionLibrary) -> Pose:
    """Return the poses ``[M, 7 + J]`` of a library in which the robot rests, over the origin and facing along x.

    In a pose at rest no joint is faster than 0.6 rad/s, the root no faster than 0.1 m/s, and the pelvis above 0.55 m.
    That height is for a robot whose root stands at 0.76 m; others in proportion. Of each clip the slowest such pose is
    taken.

    Raises:
        ConfigError: for what is no library.

    >>> from plat.motions import generate_motions
    >>> poses = resting_poses(MotionLibrary.from_clips(generate_motions("val", seconds=8)))
    >>> poses.shape[1], bool((poses[:, 2] > 0.55).all())
    (36, True)
    """
    check_value("resting_poses: library", library, MotionLibrary)
    frames = library.frames
    joint_speed = frames["joint_vel"].abs().amax(-1)
    root_speed = frames["keypoint_lin_vel"][:, 0].norm(dim=-1)
    height = frames["keypoint_pos"][:, 0, 2]
    least = in_proportion(_PELVIS_HEIGHT, library.robot.root_height)
    rests = (joint_speed < _JOINT_SPEED) & (root_speed < _ROOT_SPEED) & (height > least)
    speed = torch.where(rests, joint_speed, torch.inf)
    poses = []
    for start, length in zip(library.clip_start.tolist(), library.clip_length.tolist(), strict=True):
        slowest = start + int(speed[start : start + length].argmin())
        if torch.isfinite(speed[slowest]):
            root_quat = frames["keypoint_quat"][slowest, 0]
            root_pos = torch.cat((torch.zeros(2), height[slowest, None].cpu()))
            heading = 2 * torch.atan2(root_quat[3], root_quat[0])
            upright = quat_multiply(quat_from_rotvec(torch.tensor([0.0, 0.0, -1.0]) * heading.cpu()), root_quat.cpu())
            poses.append(torch.cat((root_pos, upright, frames["joint_pos"][slowest].cpu())))
    if not poses:
        return np.empty((0, 7 + library.robot.num_joints))
    return torch.stack(poses).double().numpy()


def _commanded(family: ChainFamily, robot: Robot) -> Parts | None:
    """Return the parts that the keyframes of a family command; None for whole poses."""
    if family.commands == "whole":
        return None
    if family.commands == "waypoint":
        return Parts.only(robot, root=("horizontal", "orientation"))
    head = (robot.keypoints[robot.anchor_index],) if family.commands == "hands_and_head" else ()
    return Parts.only(robot, bodies=(*hands_of(robot), *head))


def _sequence(robot: Robot, keyframes: Sequence[Keyframe], timing: Timing) -> KeyframeSequence:
    start = standing(robot)
    return KeyframeSequence(robot, start, split_long_intervals(start, keyframes, timing), timing)


class _Draw:
    """Sampler of a chain's poses, one after another.

    Crouches are balanced before their arms are drawn. Collisions are looked at where hands are ahead, and nowhere else.
    """

    def __init__(self, robot: Robot, random: np.random.Generator, resting: Pose | None):
        self._robot, self._random, self._resting = robot, random, resting
        self._stand = robot.default_qpos
        self._upper = np.setdiff1d(np.arange(robot.num_joints), robot.leg_joints)
        if has_six_joint_legs(robot):
            self._body = WholeBody(robot)
            feet = ForwardKinematics(robot, robot.feet)
            stand = torch.from_numpy(self._stand)
            self._feet_pos, self._feet_quat = feet(stand[:3], stand[3:7], stand[7:])
            self._com = self._body.center_of_mass(stand[None])[0, :2]
        self._solved: dict[tuple[float, float], tuple[Pose, float]] = {}
        if all(hands_of(robot)):
            self._hands = ForwardKinematics(robot, hands_of(robot))
        self._model = robot.shared_model
        self._data = mujoco.MjData(self._model)

    def chain(self, family: ChainFamily) -> list[Pose]:
        """Return the poses of one chain."""
        if family.way is not None:
            return self._walk(family.way, family.turn, family.length)
        bases = self._rests(family.length) if family.resting else [self._stand] * family.length
        if family.same:
            return [self._pose(family, bases[0])] * family.length
        if (lowered := family.lowered_of(self._robot.root_height)) is not None:
            self._solve_ahead(family, lowered)
        return [self._pose(family, base) for base in bases]

    def _pose(self, family: ChainFamily, base: Pose) -> Pose:
        pose = base.copy()
        if (lowered := family.lowered_of(self._robot.root_height)) is not None:
            pose = self._crouching(lowered, family.lean)
        if family.hands_ahead:
            pose = self._reaching(pose)
        elif family.arms:
            pose = self._arms(pose, 1)[0]
        if family.apart is not None:
            distance, turn = family.apart
            pose[:2] += self._random.uniform(-distance, distance, 2)
            pose = self._turned(pose, self._random.uniform(-turn, turn))
        return pose

    def _arms(self, base: Pose, count: int) -> Pose:
        """Return ``count`` poses with other joints than the legs' anywhere in the middle of their ranges."""
        low, high = self._robot.joint_range.double().numpy().T
        upper = self._upper
        poses = np.tile(base, (count, 1))
        share = self._random.uniform(*MIDDLE, (count, len(upper)))
        poses[:, 7 + upper] = low[upper] + share * (high - low)[upper]
        return poses

    def _reaching(self, base: Pose) -> Pose:
        """Return a pose with other joints than the legs' drawn until both hands are in front.

        No two links are :data:`plat.keyframes.chain_families.INSIDE` or more in each other, of the pairs that the
        robot's description lets collide.
        """
        for _ in range(_MOST_ROUNDS):
            poses = self._arms(base, TRIES)
            root_pos, root_quat, joint_pos = torch.from_numpy(poses).split((3, 4, self._robot.num_joints), -1)
            places, _ = self._hands(root_pos, root_quat, joint_pos)
            ahead = places[..., 0] - root_pos[:, None, 0] > AHEAD
            above = places[..., 2] > root_pos[:, None, 2]
            for row in (ahead & above).all(-1).nonzero()[:, 0].tolist():
                if self_penetration(self._model, poses[row], self._data) < INSIDE:
                    return poses[row]
        raise UndrawableError(
            f"robot {self._robot.name!r}: of {_MOST_ROUNDS * TRIES} poses none has both hands ahead of the body and "
            "above its root, and no links in each other"
        )

    def _crouching(self, lowered: tuple[float, float], lean: float) -> Pose:
        """Return a crouch with the feet in place and the center of mass where it is over them in the standing pose."""
        for _ in range(_MOST_CROUCHES):
            drawn = self._random.uniform(*lowered), self._random.uniform(0.0, lean)
            pose, off = self._solved.pop(drawn) if drawn in self._solved else self._crouched([drawn])[0]
            # deep and upright at once is beyond the ankles
            if off < _FOOT_OFF:
                return pose
        least, most = lowered
        raise UndrawableError(
            f"robot {self._robot.name!r}: its feet stay in place in none of {_MOST_CROUCHES} crouches, with the root "
            f"{100 * least:.0f} to {100 * most:.0f} cm lower and the center of mass over them"
        )

    def _solve_ahead(self, family: ChainFamily, lowered: tuple[float, float]) -> None:
        """Solve for the crouches that a chain will most likely ask for: all at once take as long as one.

        The draws are guessed on a copy of the generator. They are these where feet stay in place and the first draw of
        arms has one with the hands ahead. Others are solved for when their turn comes.
        """
        random, drawn = deepcopy(self._random), []
        for _ in range(family.length + _SPARE):
            drawn.append((random.uniform(*lowered), random.uniform(0.0, family.lean)))
            if family.arms:
                random.random((TRIES if family.hands_ahead else 1, len(self._upper)))
        self._solved = dict(zip(drawn, self._crouched(drawn), strict=True))

    def _crouched(self, drawn: Sequence[tuple[float, float]]) -> list[tuple[Pose, float]]:
        """Return crouches by how far they are lowered (m) and lean (rad), each with the error of a foot's place (m)."""
        lowered, lean = torch.tensor(drawn, dtype=torch.float64).unbind(-1)
        poses = torch.from_numpy(self._stand).repeat(len(drawn), 1)
        poses[:, 2] -= lowered
        poses[:, 3:7] = quat_from_rotvec(lean[:, None] * torch.eye(3, dtype=torch.float64)[1])
        feet_pos, feet_quat = (values.expand(len(drawn), -1, -1) for values in (self._feet_pos, self._feet_quat))
        weight = torch.ones(len(drawn), 2, dtype=torch.float64)
        for _ in range(8):
            poses[:, 7:], off, _ = self._body.solve_legs(
                poses[:, :3], poses[:, 3:7], feet_pos, feet_quat, weight, poses[:, 7:]
            )
            poses[:, :2] += self._com - self._body.center_of_mass(poses)[:, :2]
        return list(zip(poses.numpy(), off.amax(-1).tolist(), strict=True))

    def _walk(self, way: tuple[float, float], turn: float, length: int) -> list[Pose]:
        place, heading, poses = np.zeros(2), 0.0, []
        for _ in range(length):
            direction, distance = self._random.uniform(-np.pi, np.pi), self._random.uniform(*way)
            place = place + distance * np.array([np.cos(direction), np.sin(direction)])
            heading += self._random.uniform(-turn, turn)
            pose = self._stand.copy()
            pose[:2] = place
            poses.append(self._turned(pose, heading))
        return poses

    def _rests(self, count: int) -> Pose:
        """Return different resting poses ``[count, 7 + J]``, again from the first where there are fewer."""
        assert self._resting is not None
        poses = self._resting[np.resize(self._random.permutation(len(self._resting)), count)]
        low, high = self._robot.joint_range.double().numpy().T
        poses[:, 7:] = poses[:, 7:].clip(low, high)
        return poses

    @staticmethod
    def _turned(pose: Pose, angle: float) -> Pose:
        turn = quat_from_rotvec(torch.tensor([0.0, 0.0, angle], dtype=torch.float64))
        pose[3:7] = quat_multiply(turn, torch.from_numpy(pose[3:7])).numpy()
        return pose
