"""Kinematic feasibility checks: slip, penetration, ZMP balance, joint limits, speeds, self-collision."""

from dataclasses import dataclass
from itertools import combinations

import mujoco
import numpy as np

from plat.motions.checks.collision import self_penetration
from plat.motions.generation.zero_moment_point import ground_reaction, zmp_of
from plat.robots.robot import Robot, without_side
from plat.robots.sole_points import sole_points

__all__ = ["QUICK_FEET", "Soundness", "SoundnessLimits", "contact_points", "measure_soundness", "speed_limits"]

# Top speeds of the G1's motors (rad/s), as in its public description (unitree_ros, g1_29dof_rev_1_0.urdf).
_MOTOR_SPEED = {
    **dict.fromkeys(("hip_pitch", "hip_yaw", "waist_yaw"), 32.0),
    **dict.fromkeys(("hip_roll", "knee"), 20.0),
    **dict.fromkeys(("wrist_pitch", "wrist_yaw"), 22.0),
}
_MOTOR_SPEED_5020 = 37.0
_GRAVITY = 9.81
_BEARING = 0.3  # units of weight: under this vertical force the zero-moment point means little
_DOWN = 0.003  # m: points of the sole up to this height bear load


@dataclass(frozen=True)
class SoundnessLimits:
    """Limits that a generated motion satisfies."""

    slip: float = 0.005
    """largest distance that a point of the sole moves while on the floor (m)"""
    penetration: float = 0.005
    """largest depth of a sole's point below the floor (m)"""
    balanced: float = 0.99
    """smallest fraction of the frames that bear weight with the zero-moment point inside the support polygon"""
    falling: float = 0.5
    """largest difference of the center of mass's acceleration in flight from that of free fall (m/s^2)"""
    joint_excess: float = 0.0
    """largest excess over a joint's range (rad)"""
    speed: float = 0.7
    """largest joint speed, as a fraction of the motor's top speed"""
    self_penetration: float = 0.005
    """largest depth of self-collision (m)"""
    tolerance: float = 0.0
    """how far outside the support polygon the zero-moment point counts as inside (m)"""
    raised: float = 0.003
    """up to this height a point of the sole bears weight (m): a foot that rolls is loaded while its heel rises"""


QUICK_FEET = SoundnessLimits(balanced=0.7, falling=1.0, tolerance=0.03, raised=0.015)
"""Limits of running and jumping, where the weight rolls over the toes while the heel rises."""


@dataclass(frozen=True)
class Soundness:
    """Result of :func:`measure_soundness`; fields are named as in :class:`SoundnessLimits`."""

    slip: float
    penetration: float
    balanced: float
    falling: float
    joint_excess: float
    speed: float
    self_penetration: float

    def faults(self, limits: SoundnessLimits | None = None) -> list[str]:
        """Return what exceeds its limit, in words; empty for a sound motion."""
        limits = limits or SoundnessLimits()
        faults = []
        for name, value in vars(self).items():
            limit = getattr(limits, name)
            if value < limit if name == "balanced" else value > limit:
                faults.append(f"{name} {value:.4f} (limit {limit})")
        return faults


def speed_limits(robot: Robot) -> np.ndarray:
    """Return the top speed of every joint's motor ``[J]`` (rad/s)."""
    return np.array([_MOTOR_SPEED.get(without_side(name), _MOTOR_SPEED_5020) for name in robot.joint_names])


def measure_soundness(robot: Robot, qpos: np.ndarray, dt: float, limits: SoundnessLimits | None = None) -> Soundness:
    """Measure feet, balance, joints and self-collision of poses ``[F, 7 + J]``, ``dt`` seconds apart.

    The limits say how the support polygon is measured.

    >>> from plat.robots import G1
    >>> raised = np.tile(G1.default_qpos, (5, 1))
    >>> raised[:, 2] += 0.1
    >>> measure_soundness(G1, raised, 0.02).faults()
    ['balanced 0.0000 (limit 0.99)', 'falling 9.8100 (limit 0.5)']
    """
    limits = limits or SoundnessLimits()
    qpos = qpos.astype(np.float64)
    model = robot.model()
    points, depth = contact_points(robot, model, qpos)  # (F, 2 feet, 4 points, 3)
    force, moment = ground_reaction(model, qpos, dt)
    force /= _GRAVITY * model.body_subtreemass[0]  # in units of weight
    zmp = zmp_of(force, moment / (_GRAVITY * model.body_subtreemass[0]), qpos, least=_BEARING)
    down = points[..., 2] < _DOWN
    bearing = force[:, 2] > _BEARING
    low, high = robot.joint_range.double().numpy().T
    joint_pos = qpos[:, 7:]
    speed = np.abs(np.diff(joint_pos, axis=0)).max(0) / dt / speed_limits(robot)
    return Soundness(
        slip=_slip(points, down),
        penetration=float(max(0.0, -points[..., 2].min())),
        balanced=float(
            (support_margin(points, points[..., 2] < limits.raised, zmp) >= -limits.tolerance)[bearing].mean()
        )
        if bearing.any()
        else 0.0,
        falling=_GRAVITY * float(np.linalg.norm(force, axis=-1)[_in_flight(down)].max(initial=0.0)),
        # clips are stored in single precision
        joint_excess=float(np.maximum(low - joint_pos, joint_pos - high).max().clip(1e-6) - 1e-6),
        speed=float(speed.max()),
        self_penetration=depth,
    )


def _in_flight(down: np.ndarray) -> np.ndarray:
    """Return the frames ``[F]`` in which no point is down, nor in the frames beside them."""
    aloft = np.asarray(~down.reshape(len(down), -1).any(-1))
    inner = aloft.copy()
    inner[1:] &= aloft[:-1]
    inner[:-1] &= aloft[1:]
    inner[[0, -1]] = False  # there the motion is at rest
    return inner


def contact_points(robot: Robot, model: mujoco.MjModel, qpos: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the lowest points of the soles ``[F, 2, P, 3]`` (m, world) and the depth of self-collision (m)."""
    data = mujoco.MjData(model)
    centers, radii = sole_points(robot, model)
    feet = [model.body(foot).id for foot in robot.feet]
    points, depth = [], 0.0
    for pose in qpos:
        depth = max(depth, self_penetration(model, pose, data))
        turned = centers @ data.xmat[feet].reshape(-1, 3, 3).transpose(0, 2, 1)
        points.append(data.xpos[feet][:, None] + turned)
    lowest = np.stack(points)
    lowest[..., 2] -= radii
    return lowest, depth


def _slip(points: np.ndarray, down: np.ndarray) -> float:
    """Return the largest distance (m) of a point from its touch-down position, while it stays down."""
    touch = points[..., :2].copy()
    for frame in range(1, len(touch)):
        stays = (down[frame] & down[frame - 1])[..., None]
        touch[frame] = np.where(stays, touch[frame - 1], touch[frame])
    return float((np.linalg.norm(points[..., :2] - touch, axis=-1) * down).max())


def support_margin(points: np.ndarray, down: np.ndarray, zmp: np.ndarray) -> np.ndarray:
    """Return the margin of ``zmp`` ``[F, 2]`` inside the convex hull of loaded points ``[F]`` (m; negative: outside).

    Args:
        points: ``[F, 2, P, 3]`` (m).
        down: which of them bear load ``[F, 2, P]``.

    >>> square = np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]], dtype=float)[None]
    >>> support_margin(square, np.ones((1, 2, 2), bool), np.array([[0.9, 0.5]])).round(2).tolist()
    [0.1]
    """
    flat, down = points[..., :2].reshape(len(points), -1, 2), down.reshape(len(points), -1)
    margin = np.full(len(points), np.inf)
    # every edge of the hull joins two of the points, and every line through two of them bounds it or cuts it
    for first, second in combinations(range(flat.shape[1]), 2):
        edge = flat[:, second] - flat[:, first]
        length = np.linalg.norm(edge, axis=-1).clip(1e-9)[:, None]
        normal = np.stack((-edge[:, 1], edge[:, 0]), -1) / length
        for side in (normal, -normal):
            reach = np.where(down, (flat * side[:, None]).sum(-1), -np.inf).max(-1)
            margin = np.minimum(margin, reach - (zmp * side).sum(-1))
    return margin
