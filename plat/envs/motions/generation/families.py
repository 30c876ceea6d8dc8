"""Kinds of motion, each from a random generator to a clip."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from plat.envs.motions.generation.balance import com_from_zmp
from plat.envs.motions.generation.curves import hold_and_move
from plat.envs.motions.generation.steps import Footstep, Walk, plan_walk
from plat.envs.motions.generation.whole_body import WholeBody
from plat.errors import MotionError
from plat.rotations import quat_from_rotvec, quat_multiply

__all__ = ["DT", "FAMILIES", "Family"]

DT = 0.02
"""Seconds a frame of every generated motion."""
_SOLE = 0.035  # m: height of the ankle body above the sole, and how far the sole's middle lies before it

_OUT_OF_REACH = 5e-4  # m, and rad at a lever of 1 m: a foot that stays further off cannot be put where it belongs


@dataclass
class Draft:
    """A motion before its legs are solved.

    Attributes:
        time: ``[F]`` (s).
        root_height: ``[F]`` (m).
        root_rotvec: roll, pitch and yaw of the pelvis ``[F, 3]`` (small angles, rad).
        joint_pos: all angles ``[F, J]`` (rad); the legs are solved later.
        walk: feet and weight.
    """

    time: Tensor
    root_height: Tensor
    root_rotvec: Tensor
    joint_pos: Tensor
    walk: Walk


class Studio:
    """Turns drafts into balanced poses.

    Args:
        body: the robot's kinematics.
    """

    def __init__(self, body: WholeBody):
        self.body = body
        self.robot = body.robot
        default = torch.from_numpy(self.robot.default_qpos)
        feet, _ = body.feet(default[None])
        self.stance = torch.cat((feet[0, :, :2], torch.zeros(2, 1, dtype=torch.float64)), -1)
        """x, y (m) and yaw (rad) of the feet in the default pose ``[2, 3]``."""
        self.com_height = float(body.center_of_mass(default[None])[0, 2])

    def draft(self, seconds: float) -> Draft:
        """The default pose, standing still."""
        count = round(seconds / DT) + 1
        walk = plan_walk(
            self.stance,
            [],
            step_time=1.0,
            double_support=0.3,
            clearance=0.0,
            sole_center=_SOLE,
            rest=(count - 1) * DT / 2,
            dt=DT,
        )
        return self.walking_draft(walk)

    def walking_draft(self, walk: Walk) -> Draft:
        """The default posture over the feet of a walk."""
        count = len(walk.zmp)
        return Draft(
            time=torch.arange(count, dtype=torch.float64) * DT,
            root_height=torch.full((count,), self.robot.root_height, dtype=torch.float64),
            root_rotvec=torch.zeros(count, 3, dtype=torch.float64),
            joint_pos=self.robot.default_joint_pos.double().expand(count, -1).clone(),
            walk=walk,
        )

    def joint(self, name: str) -> int:
        """Column of a joint."""
        return self.robot.joint_names.index(name)

    def finish(self, draft: Draft) -> np.ndarray:
        """Positions ``[F, 7 + J]`` with the feet where they belong and the centre of mass where balance wants it."""
        walk, count = draft.walk, len(draft.time)
        com = com_from_zmp(walk.zmp, self.com_height, DT)
        zero = torch.zeros(count, dtype=torch.float64)
        feet_pos = walk.foot_pos + torch.tensor([0.0, 0.0, _SOLE], dtype=torch.float64)
        feet_quat = quat_from_rotvec(torch.stack((zero[:, None].expand(-1, 2),) * 2 + (walk.foot_yaw,), -1))
        heading = quat_from_rotvec(torch.stack((zero, zero, walk.foot_yaw.mean(-1)), -1))
        root_quat = quat_multiply(heading, quat_from_rotvec(draft.root_rotvec))
        root_pos = torch.cat((com, draft.root_height[:, None]), -1)
        joint_pos = draft.joint_pos
        # moving the pelvis moves nearly all of the mass with it, so this settles in a few rounds
        for _ in range(4):
            joint_pos, _ = self.body.solve_legs(root_pos, root_quat, feet_pos, feet_quat, joint_pos)
            qpos = torch.cat((root_pos, root_quat, joint_pos), -1)
            root_pos = root_pos.clone()
            root_pos[:, :2] += com - self.body.center_of_mass(qpos)[:, :2]
        joint_pos, off = self.body.solve_legs(root_pos, root_quat, feet_pos, feet_quat, joint_pos)
        if off.max() > _OUT_OF_REACH:
            frame, foot = divmod(int(off.argmax()), 2)
            raise MotionError(
                f"a foot ({('left', 'right')[foot]}) is out of reach at frame {frame}: off by {off.max():.3f}"
            )
        return torch.cat((root_pos, root_quat, joint_pos), -1).float().numpy()


Family = Callable[[Studio, np.random.Generator], np.ndarray]


def _tensor(values: np.ndarray | list[float] | float) -> Tensor:
    return torch.as_tensor(values, dtype=torch.float64)


def _moves(
    rng: np.random.Generator, targets: list[Tensor], move: tuple[float, float], hold: tuple[float, float]
) -> tuple:
    """Movements to each target and back to where the first began, with their total time."""
    begin, points = 0.4, []
    for target in targets:
        duration = rng.uniform(*move)
        points.append((begin, duration, target))
        begin += duration + rng.uniform(*hold)
    return points, begin + 0.4


# Angles (rad) of shoulder pitch, roll (outward), yaw (inward), elbow, wrist roll, pitch and yaw that arms may take in
# gestures: inside every joint's range, and clear of the trunk.
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
_ARM_LOW = np.array([-2.2, 0.15, -0.5, -0.3, -0.6, -0.4, -0.4])
_ARM_HIGH = np.array([0.4, 1.2, 0.5, 1.2, 0.6, 0.4, 0.4])
# Which of them have the opposite sign on the right.
_MIRRORED = np.array([1, -1, -1, 1, -1, 1, -1])


def _arm_columns(studio: Studio, side: int) -> list[int]:
    return [studio.joint(f"{('left', 'right')[side]}_{name}") for name in _ARM]


def _arm_pose(rng: np.random.Generator, side: int, low: np.ndarray = _ARM_LOW, high: np.ndarray = _ARM_HIGH) -> Tensor:
    angles = rng.uniform(low, high)
    return _tensor(angles * (_MIRRORED if side else 1))


def stand(studio: Studio, rng: np.random.Generator) -> np.ndarray:
    """Standing with slow shifts of the weight and of the gaze."""
    draft = studio.draft(rng.uniform(4, 6))
    swing = 2 * np.pi * rng.uniform(0.15, 0.35) * draft.time + rng.uniform(0, 6)
    fade = hold_and_move(
        draft.time, [(0.0, 1.0, _tensor([1.0])), (float(draft.time[-1]) - 1, 1.0, _tensor([0.0]))], _tensor([0.0])
    )
    sway = torch.stack(
        (_tensor(rng.uniform(0, 0.012)) * swing.cos(), _tensor(rng.uniform(0.005, 0.03)) * swing.sin()), -1
    )
    draft.walk = Walk(draft.walk.foot_pos, draft.walk.foot_yaw, draft.walk.zmp + fade * sway)
    draft.joint_pos[:, studio.joint("waist_yaw")] += (fade[:, 0] * rng.uniform(-0.3, 0.3)) * (0.7 * swing).sin()
    return studio.finish(draft)


def reach(studio: Studio, rng: np.random.Generator) -> np.ndarray:
    """One hand or both go to a few places, the trunk turning and leaning with them."""
    sides = [[0], [1], [0, 1]][rng.integers(3)]
    points, seconds = _moves(rng, [_tensor([0.0])] * (rng.integers(2, 4) + 1), (0.7, 1.4), (0.2, 0.7))
    draft = studio.draft(seconds)
    for side in sides:
        columns = _arm_columns(studio, side)
        home = draft.joint_pos[0, columns]
        targets = [_arm_pose(rng, side) for _ in points[:-1]] + [home]
        path = [(begin, duration, target) for (begin, duration, _), target in zip(points, targets, strict=True)]
        draft.joint_pos[:, columns] = hold_and_move(draft.time, path, home)
    waist = [studio.joint("waist_yaw"), studio.joint("waist_roll"), studio.joint("waist_pitch")]
    targets = [_tensor(rng.uniform([-0.7, -0.15, -0.1], [0.7, 0.15, 0.35])) for _ in points[:-1]] + [_tensor([0.0] * 3)]
    path = [(begin, duration, target) for (begin, duration, _), target in zip(points, targets, strict=True)]
    draft.joint_pos[:, waist] = hold_and_move(draft.time, path, _tensor([0.0] * 3))
    return studio.finish(draft)


def wave(studio: Studio, rng: np.random.Generator) -> np.ndarray:
    """A raised hand waves."""
    side = int(rng.integers(2))
    raised = _arm_pose(
        rng, side, np.array([-1.6, 0.4, -0.2, -0.6, -0.2, -0.2, -0.2]), np.array([-0.6, 1.1, 0.2, 0.3, 0.2, 0.2, 0.2])
    )
    up, hold, down = rng.uniform(0.7, 1.1), rng.uniform(1.5, 3.0), rng.uniform(0.7, 1.1)
    draft = studio.draft(0.8 + up + hold + down)
    columns = _arm_columns(studio, side)
    home = draft.joint_pos[0, columns]
    draft.joint_pos[:, columns] = hold_and_move(draft.time, [(0.4, up, raised), (0.4 + up + hold, down, home)], home)
    envelope = hold_and_move(
        draft.time, [(0.4 + up, 0.4, _tensor([1.0])), (up + hold, 0.4, _tensor([0.0]))], _tensor([0.0])
    )[:, 0]
    beat = (2 * np.pi * rng.uniform(0.8, 1.6) * draft.time).sin()
    draft.joint_pos[:, studio.joint(f"{('left', 'right')[side]}_shoulder_yaw")] += (
        rng.uniform(0.2, 0.45) * envelope * beat
    )
    draft.joint_pos[:, studio.joint("waist_yaw")] += rng.uniform(-0.3, 0.3) * envelope
    return studio.finish(draft)


def squat(studio: Studio, rng: np.random.Generator) -> np.ndarray:
    """Down, a moment there, up again; the arms come forward for balance."""
    times = rng.integers(1, 3)
    targets = [point for _ in range(times) for point in (_tensor([rng.uniform(0.08, 0.2)]), _tensor([0.0]))]
    points, seconds = _moves(rng, targets, (1.0, 1.8), (0.1, 0.6))
    draft = studio.draft(seconds)
    drop = hold_and_move(draft.time, points, _tensor([0.0]))[:, 0]
    draft.root_height -= drop
    draft.root_rotvec[:, 1] = rng.uniform(0.5, 1.5) * drop
    draft.joint_pos[:, studio.joint("waist_pitch")] += rng.uniform(0.5, 1.2) * drop
    forward = rng.uniform(2.0, 5.0)
    for side in ("left", "right"):
        draft.joint_pos[:, studio.joint(f"{side}_shoulder_pitch")] -= forward * drop
    return studio.finish(draft)


def bow(studio: Studio, rng: np.random.Generator) -> np.ndarray:
    """The trunk bends forward from hips and waist."""
    points, seconds = _moves(rng, [_tensor([1.0]), _tensor([0.0])], (0.9, 1.6), (0.3, 1.0))
    draft = studio.draft(seconds)
    bend = hold_and_move(draft.time, points, _tensor([0.0]))[:, 0]
    draft.root_rotvec[:, 1] = rng.uniform(0.15, 0.45) * bend
    draft.joint_pos[:, studio.joint("waist_pitch")] += rng.uniform(0.2, 0.45) * bend
    for side in ("left", "right"):
        draft.joint_pos[:, studio.joint(f"{side}_shoulder_pitch")] -= rng.uniform(0.0, 0.5) * bend
    return studio.finish(draft)


def _swing_arms(studio: Studio, draft: Draft, gain: float) -> None:
    """Each arm follows the foot of the other side."""
    ahead = draft.walk.foot_pos[:, 0, :2] - draft.walk.foot_pos[:, 1, :2]
    yaw = draft.walk.foot_yaw.mean(-1)
    lead = ahead[:, 0] * yaw.cos() + ahead[:, 1] * yaw.sin()
    draft.joint_pos[:, studio.joint("left_shoulder_pitch")] += gain * lead
    draft.joint_pos[:, studio.joint("right_shoulder_pitch")] -= gain * lead


def step_in_place(studio: Studio, rng: np.random.Generator) -> np.ndarray:
    """Stepping from foot to foot on the spot."""
    first = int(rng.integers(2))
    feet = [(first + index) % 2 for index in range(2 * rng.integers(2, 5))]
    steps = [Footstep(foot, *studio.stance[foot].tolist()) for foot in feet]
    walk = plan_walk(
        studio.stance,
        steps,
        step_time=rng.uniform(0.55, 0.85),
        double_support=0.35,
        clearance=rng.uniform(0.03, 0.08),
        sole_center=_SOLE,
        rest=0.7,
        dt=DT,
    )
    draft = studio.walking_draft(walk)
    draft.root_height -= rng.uniform(0.01, 0.03)
    lift = walk.foot_pos[:, 0, 2] - walk.foot_pos[:, 1, 2]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        draft.joint_pos[:, studio.joint(f"{side}_shoulder_pitch")] += sign * rng.uniform(1.0, 3.0) * lift
    return studio.finish(draft)


def walk(studio: Studio, rng: np.random.Generator) -> np.ndarray:
    """Slow walking forward or backward, straight or in a curve."""
    # flat soles cannot stretch as far backward, or on the outside of a curve
    backward, curved = rng.random() < 0.25, rng.random() < 0.5
    stride = rng.uniform(0.08, 0.18) * (-0.6 if backward else 1.0) * (0.7 if curved else 1.0)
    turn = curved * rng.uniform(-0.12, 0.12)
    first = int(rng.integers(2))
    position, yaw, steps = np.zeros(2), 0.0, []
    offset = studio.stance.numpy()
    count = int(rng.integers(4, 9))
    for index in range(count + 1):
        foot = (first + index) % 2
        # half a stride to set off and to slow down; the last step brings the feet together
        if index < count:
            yaw += turn
            position = position + stride * (0.5 if index in (0, count - 1) else 1.0) * np.array(
                [np.cos(yaw), np.sin(yaw)]
            )
        turned = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]) @ offset[foot, :2]
        x, y = (position + turned).tolist()
        steps.append(Footstep(foot, x, y, yaw))
    plan = plan_walk(
        studio.stance,
        steps,
        step_time=rng.uniform(0.6, 0.85),
        double_support=0.3,
        clearance=rng.uniform(0.04, 0.08),
        sole_center=_SOLE,
        rest=0.8,
        dt=DT,
    )
    draft = studio.walking_draft(plan)
    draft.root_height -= 0.02 + 0.12 * abs(stride)
    _swing_arms(studio, draft, rng.uniform(0.4, 1.0))
    return studio.finish(draft)


FAMILIES: dict[str, Family] = {
    "stand": stand,
    "reach": reach,
    "wave": wave,
    "squat": squat,
    "bow": bow,
    "step": step_in_place,
    "walk": walk,
}
"""Every kind of motion by name."""
