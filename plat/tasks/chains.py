"""Keyframes as a person would draw them: families of chains that begin in the standing pose."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import mujoco
import torch
from torch import Tensor

from plat.bounds import Count, Seed, as_names, check_value
from plat.errors import TaskError
from plat.keyframes.chain_families import AHEAD, FAMILY_TABLE, INSIDE, MIDDLE, RESTING, TRIES, ChainFamily
from plat.keyframes.chain_needs import lacking
from plat.keyframes.partial import hands_of
from plat.motions.checks.collision import self_penetration
from plat.motions.library import MotionLibrary
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot
from plat.rotations import quat_conjugate, quat_from_rotvec, quat_multiply, quat_to_rotvec, quat_yaw
from plat.spec.proportions import in_proportion
from plat.spec.timing import Timing
from plat.tasks.settings import CHAIN_FAMILIES
from plat.tasks.ways_around import WaysAround

__all__ = ["CHAIN_FAMILIES", "KeyframeChains", "draw_chains"]


# Frames of a library that are looked at for resting poses, at most about, and at a time.
_LOOKED_AT, _CHUNK = 1 << 22, 1 << 16
# Holds after a chain (s), the fraction of long ones, and of the poses of motions, which are there to be held.
_HOLD, _LONG_HOLD, _LONG, _HOLD_OF_MOTIONS = 3.0, 15.0, 0.25, 5.0


@dataclass(frozen=True)
class KeyframeChains:
    """Chains of keyframes for one robot, all their poses in one table.

    Attributes:
        qpos: poses ``[R, 7 + J]``; the first row of each chain is the standing pose at the origin.
        steps: control steps ``[R]`` from the row before to each; 0 for a chain's first.
        next_row: row ``[R]`` that is commanded after each; the last of a chain is commanded on and on.
        chain: chain ``[R]`` that each row belongs to.
        first_row: first row ``[C]`` of each chain.
        duration: control steps ``[C]`` of each chain with the hold after it.
        family: name of each of the C chains.
        moves: whether each of the C chains leads away from where it begins.
        commands: kind of the masks of each of the C chains (:data:`plat.envs.part_masks.PART_KINDS`); empty for any.
        middle: poses ``[M, 7 + J]`` midway to keyframes where the straight line leads through the robot itself.
        middle_row: which of them ``[R]`` is passed on the way to each row; -1 for none.
    """

    qpos: Tensor
    steps: Tensor
    next_row: Tensor
    chain: Tensor
    first_row: Tensor
    duration: Tensor
    family: tuple[str, ...]
    moves: Tensor
    commands: tuple[str, ...]
    middle: Tensor
    middle_row: Tensor


def draw_chains(
    library: MotionLibrary,
    count: int,
    families: Sequence[str] = CHAIN_FAMILIES,
    *,
    seed: int = 0,
    timing: Timing | None = None,
) -> KeyframeChains:
    """Draw ``count`` chains, as many of each family as of the others to within one.

    ===========  ==================================================================================  =======
    family       keyframes, 0.5 to 1 s apart                                                         hold
    ===========  ==================================================================================  =======
    hold         one resting pose of a motion                                                        5 s
    arms         legs and root as they stand, the other joints in the middle 60 % of their ranges    3 s
    poses        resting poses of the motions, within 0.1 m and 0.2 rad                              3 s
    steps        the standing pose 0.25 to 0.5 m further, turned by up to 0.4 rad                    3 s
    crouch       pelvis 0.05 to 0.3 m lower, leaning by up to 0.5 rad, feet in place                 3 s
    reach        legs and root as they stand, the hands in front; they alone are commanded           3 s
    three_point  crouches of up to 0.15 m, the hands in front; they and the trunk are commanded      3 s
    far          the standing pose 1.5 to 2.5 m further, turned by up to 2 rad: out of reach         3 s
    distant      the same 0.8 to 2.5 m further, 1.5 s apart or more, where the timing allows 2 s     3 s
    ===========  ==================================================================================  =======

    Where the straight line between two poses of arms leads through the robot itself, a pose midway leads around it. The
    chain then goes to and fro between the two. A quarter of the chains that stay in place end in a hold of 15 s,
    because a drifting robot falls late. Where the timing allows more than a second, three of ten keyframes take up to
    its longest command. Where it allows less, none takes longer.

    Args:
        library: motions with the resting poses; families that need some are left out where there are none, those
            that reach where the robot has no hands or brings none ahead, and those that go lower where its legs are
            not of six joints.
        count: number of chains.
        families: some of :data:`CHAIN_FAMILIES`.
        seed: draws them, apart from the global generator.
        timing: of the policy; None for the default at the control step of the motions.

    Raises:
        ConfigError: for another argument that makes no sense.
        TaskError: for an unknown family, or where none of the families can be drawn.

    >>> from plat.motions import generate_motions
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> chains = draw_chains(library, 4, ["arms", "steps"])
    >>> chains.family, chains.qpos.shape
    (('arms', 'arms', 'steps', 'steps'), torch.Size([24, 36]))
    """
    check_value("draw_chains: library", library, MotionLibrary)
    check_value("draw_chains: count", count, Count)
    check_value("draw_chains: seed", seed, Seed)
    check_value("draw_chains: timing", timing, Timing | None)
    families = as_names(families)
    unknown = [family for family in families if family not in CHAIN_FAMILIES]
    if unknown:
        raise TaskError(f"families: {unknown[0]!r}, expected some of {CHAIN_FAMILIES}")
    timing = timing or Timing(control_dt=library.dt)
    longest, second = timing.max_steps, timing.steps(1.0)
    usual = (min(max(1, timing.steps(0.5)), longest), min(second, longest) + 1)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        resting = _resting_poses(library).cpu()
        drawn = [
            family
            for family in (FAMILY_TABLE[name] for name in families)
            if (longest >= 2 * second or not _distant(family))
            and not lacking(family, library.robot, resting)
            and (not family.hands_ahead or _hands_come_ahead(library.robot))
        ]
        if not drawn:
            raise TaskError(
                f"families: {', '.join(families)} start from poses at rest, which the motions have none of, need a "
                f"longest command of {2 * second} steps, hands that come ahead of the robot, or legs of six joints"
            )
        parts: list[tuple[ChainFamily, Tensor, Tensor, Tensor]] = []
        for number, family in enumerate(drawn[:count]):
            share = (count - number - 1) // len(drawn) + 1  # the first families have one more where it does not divide
            poses = _chains(family, share, library.robot, resting)
            steps = torch.randint(*usual, poses.shape[:2])
            if _distant(family):
                steps = torch.randint(timing.steps(family.interval[0]), longest + 1, poses.shape[:2])
            elif longest > second and not family.out_of_reach:
                slow = torch.rand(poses.shape[:2]) < 0.3
                steps = torch.where(slow, torch.randint(second, longest + 1, poses.shape[:2]), steps)
            hold = torch.full((share,), _HOLD_OF_MOTIONS if family.same else _HOLD)
            if family.way is None:
                hold[torch.rand(share) < _LONG] = _LONG_HOLD
            parts.append((family, poses, steps, (hold / timing.control_dt).round().long()))
    return _joined(parts, library)


def _joined(parts: Sequence[tuple[ChainFamily, Tensor, Tensor, Tensor]], library: MotionLibrary) -> KeyframeChains:
    """One table of chains, given by family with poses, times and hold."""
    standing = torch.as_tensor(library.robot.default_qpos, dtype=torch.float32)
    rows, steps, next_row, chain = [], [], [], []
    ways = WaysAround(library.robot)
    middle: list[Tensor] = []
    middle_row: list[int] = []
    first, duration = [], []
    drawn: list[ChainFamily] = []
    begin = 0
    for family, poses, times, holds in parts:
        for path, path_steps, hold in zip(poses, times, holds.tolist(), strict=True):
            last = begin + len(path)
            qpos = torch.cat((standing[None], path))
            qpos, passed = _with_ways(qpos, ways) if family.arms else (qpos, [None] * len(path))
            rows.append(qpos)
            steps.append(torch.nn.functional.pad(path_steps, (1, 0)))
            next_row.append(torch.arange(begin + 1, last + 2).clamp_max(last))
            chain.append(torch.full((len(path) + 1,), len(drawn)))
            first.append(begin)
            duration.append(int(path_steps.sum()) + hold)
            for pose in (None, *passed):
                middle_row.append(-1 if pose is None else len(middle))
                middle += [] if pose is None else [pose]
            drawn.append(family)
            begin = last + 1
    device = library.device
    return KeyframeChains(
        qpos=torch.cat(rows).to(device),
        steps=torch.cat(steps).to(device),
        next_row=torch.cat(next_row).to(device),
        chain=torch.cat(chain).to(device),
        first_row=torch.tensor(first, device=device),
        duration=torch.tensor(duration, device=device),
        family=tuple(family.name for family in drawn),
        moves=torch.tensor([family.way is not None for family in drawn], device=device),
        commands=tuple("" if family.commands == "whole" else family.commands for family in drawn),
        middle=torch.stack(middle).to(device) if middle else standing.new_empty(0, len(standing), device=device),
        middle_row=torch.tensor(middle_row, device=device),
    )


def _with_ways(qpos: Tensor, ways: WaysAround) -> tuple[Tensor, list[Tensor | None]]:
    """A chain's poses ``[n + 1, 7 + J]``, and n poses to pass midway between them; None where the line is straight.

    Few lines are not, and they are hard to learn: a chain with one is changed to lead to and fro on it.
    """
    for row, pair in enumerate(pairwise(qpos)):
        if (passed := ways.between(*pair)) is not None:
            first = min(row, 1)  # the pair may begin with the standing pose, as the chain does
            to_and_fro = torch.stack(pair).repeat(len(qpos), 1)[: len(qpos) - first]
            changed = torch.cat((qpos[:first], to_and_fro))
            return changed, [ways.between(*changed[:2])] * first + [passed] * (len(to_and_fro) - 1)
    return qpos, [None] * (len(qpos) - 1)


def _resting_poses(library: MotionLibrary) -> Tensor:
    """Poses ``[R, 7 + J]`` of a library in which the robot stands about still, at the origin, looking along x."""
    joint_speed, root_speed, height = RESTING
    least = in_proportion(height, library.robot.root_height)
    found = []
    # of a large library a part of the frames is looked at, evenly, and a part at a time
    for rows in torch.arange(0, len(library), 1 + len(library) // _LOOKED_AT, device=library.device).split(_CHUNK):
        frames = library.states(rows)
        still = (
            (frames["joint_vel"].abs().amax(-1) < joint_speed)
            & (frames["keypoint_lin_vel"][:, 0].norm(dim=-1) < root_speed)
            & (frames["keypoint_pos"][:, 0, 2] > least)
        )
        found.append(rows[still])
    qpos = library.qpos(torch.cat(found))
    qpos[:, :2] = 0
    qpos[:, 3:7] = quat_multiply(quat_conjugate(quat_yaw(qpos[:, 3:7])), qpos[:, 3:7])
    return qpos


def _uniform(low: float, high: float, *shape: int) -> Tensor:
    return low + (high - low) * torch.rand(*shape)


def _turns(angle: Tensor) -> Tensor:
    """Quaternions ``[*B, 4]`` of turns about the vertical ``[*B]`` (rad)."""
    return quat_from_rotvec(torch.nn.functional.pad(angle[..., None], (2, 0)))


def _standing(robot: Robot, *shape: int) -> Tensor:
    return torch.as_tensor(robot.default_qpos, dtype=torch.float32).repeat(*shape, 1)


def _distant(family: ChainFamily) -> bool:
    """Whether the time between keyframes goes up to the policy's longest command."""
    return math.isinf(family.interval[1])


def _chains(family: ChainFamily, count: int, robot: Robot, resting: Tensor) -> Tensor:
    """Poses ``[count, keyframes, 7 + J]`` of chains of a family."""
    if family.way is not None:
        return _walks(family, count, robot)
    length = 1 if family.same else family.length
    qpos = resting[torch.randint(len(resting), (count, length))] if family.resting else _standing(robot, count, length)
    if (lowered := family.lowered_of(robot.root_height)) is not None:
        qpos = _crouched(count * length, robot, lowered, family.lean).unflatten(0, (count, length))
    if family.hands_ahead:
        qpos = _reaching(qpos.flatten(0, 1), robot).unflatten(0, (count, length))
    elif family.arms:
        qpos = _arms(qpos, robot)
    if family.apart is not None:
        distance, turn = family.apart
        qpos[..., :2] += _uniform(-distance, distance, count, length, 2)
        qpos[..., 3:7] = quat_multiply(_turns(_uniform(-turn, turn, count, length)), qpos[..., 3:7])
    return qpos


def _walks(family: ChainFamily, count: int, robot: Robot) -> Tensor:
    if not family.out_of_reach:
        return _walk(family, count, robot, family.length)
    # in half of the chains each keyframe is commanded three times, the others lead on and on
    again = _walk(family, count, robot, 2).repeat_interleave(3, 1)
    onward = _walk(family, count, robot, 6)
    return torch.where(torch.rand(count, 1, 1) < 0.5, again, onward)


def _walk(family: ChainFamily, count: int, robot: Robot, length: int) -> Tensor:
    assert family.way is not None
    qpos = _standing(robot, count, length)
    way, heading = _uniform(*family.way, count, length), _uniform(-torch.pi, torch.pi, count, length)
    qpos[..., 0] = (way * heading.cos()).cumsum(1)
    qpos[..., 1] = (way * heading.sin()).cumsum(1)
    qpos[..., 3:7] = _turns(_uniform(-family.turn, family.turn, count, length).cumsum(1))
    return qpos


def _arms(qpos: Tensor, robot: Robot) -> Tensor:
    """The same poses ``[*B, 7 + J]`` with other joints than the legs' anywhere in the middle of their ranges."""
    upper = [joint for joint in range(robot.num_joints) if joint not in robot.leg_joints]
    low, high = robot.joint_range[upper].unbind(-1)
    qpos = qpos.clone()
    qpos[..., [7 + joint for joint in upper]] = low + _uniform(*MIDDLE, *qpos.shape[:-1], len(upper)) * (high - low)
    return qpos


def _hands_in_front(qpos: Tensor, robot: Robot) -> Tensor:
    """The mask ``[*B]`` of poses ``[*B, 7 + J]`` with both hands ahead of the root and above it."""
    places = ForwardKinematics(robot, hands_of(robot))(*_split(qpos))[0] - qpos[..., None, :3]
    return ((places[..., 0] > AHEAD) & (places[..., 2] > 0)).all(-1)


def _hands_come_ahead(robot: Robot) -> bool:
    """Whether a robot has poses with both hands in front: others would be told to reach behind themselves."""
    with torch.random.fork_rng(devices=[]):  # the chains of a seed stay as they are
        return bool(_hands_in_front(_arms(_standing(robot, 64 * TRIES), robot), robot).any())


def _reaching(qpos: Tensor, robot: Robot) -> Tensor:
    """The same poses ``[R, 7 + J]`` with other joints than the legs' drawn until both hands are in front.

    Commands of arms that are in each other teach a robot to press them together: such draws are left out, unless all of
    a pose's are of the kind.
    """
    tried = _arms(qpos[:, None].expand(-1, TRIES, -1), robot)
    in_front = _hands_in_front(tried, robot)
    data = mujoco.MjData(robot.shared_model)
    chosen = []
    for poses, fits in zip(tried, in_front, strict=True):
        candidates = poses[fits] if fits.any() else poses
        clear = (pose for pose in candidates if self_penetration(robot.shared_model, pose.numpy(), data) < INSIDE)
        chosen.append(next(clear, candidates[0]))
    return torch.stack(chosen)


def _crouched(count: int, robot: Robot, lowered: tuple[float, float], most_lean: float) -> Tensor:
    """Poses ``[count, 7 + J]`` with the pelvis lower, leaning to any side, and the feet in place."""
    qpos = _standing(robot, count)
    lean, about = _uniform(0.0, most_lean, count), _uniform(-torch.pi, torch.pi, count)
    axis = torch.stack((about.cos(), about.sin(), torch.zeros(count)), -1)
    drop = _uniform(*lowered, count)
    # the pelvis gives way to where the trunk does not lean, as a person's does: the weight stays above the feet
    back = 0.2 * lean.sin()[:, None] * torch.stack((-axis[:, 1], axis[:, 0]), -1)
    qpos[:, :2] += back
    qpos[:, 2] -= drop
    qpos[:, 3:7] = quat_from_rotvec(lean[:, None] * axis)
    return _feet_in_place(qpos, robot)


def _feet_in_place(qpos: Tensor, robot: Robot, iterations: int = 12) -> Tensor:
    """Poses ``[R, 7 + J]`` whose legs are bent so that the feet are where they are in the standing pose."""
    kinematics, legs = ForwardKinematics(robot, robot.feet), [7 + joint for joint in robot.leg_joints]
    low, high = robot.joint_range[robot.leg_joints].unbind(-1)
    wanted_pos, wanted_quat = kinematics(*_split(_standing(robot, 1)))

    def error(poses: Tensor) -> Tensor:
        pos, quat = kinematics(*_split(poses))
        turn = quat_to_rotvec(quat_multiply(quat, quat_conjugate(wanted_quat).expand_as(quat)))
        return torch.cat((pos - wanted_pos, 0.3 * turn), -1).flatten(1)

    qpos = qpos.clone()
    nudge = 1e-3 * torch.eye(len(legs))
    for _ in range(iterations):
        now = error(qpos)
        tried = qpos.repeat_interleave(len(legs), 0)
        tried[:, legs] += nudge.repeat(len(qpos), 1)
        jacobian = (error(tried).view(len(qpos), len(legs), -1) - now[:, None]) / 1e-3  # (R, legs, errors)
        normal = jacobian @ jacobian.transpose(1, 2) + 1e-3 * torch.eye(len(legs))
        step = torch.linalg.solve(normal, jacobian @ now[:, :, None])[..., 0]
        qpos[:, legs] = (qpos[:, legs] - step.clamp(-0.3, 0.3)).clamp(low, high)
    return qpos


def _split(qpos: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    return qpos[..., :3], qpos[..., 3:7], qpos[..., 7:]
