"""Motion solver: legs by inverse kinematics, and the pelvis where balance needs it."""

import numpy as np
import torch
from torch import Tensor

from plat.errors import MotionError
from plat.motions.generation.interpolation import minimum_jerk
from plat.motions.generation.script import SIDES, SOLE_CENTER, Draft
from plat.motions.generation.whole_body import WholeBody
from plat.motions.generation.zero_moment_point import (
    InvertedPendulum,
    VaryingPendulum,
    ground_reaction,
    zero_moment_point,
    zmp_of,
)
from plat.rotations import quat_from_rotvec, quat_multiply, quat_rotate

__all__ = ["DT", "Solver"]

DT = 0.02
"""Seconds a frame of every generated motion."""

_ANKLE_HEIGHT = 0.035  # m above the sole
_TOE, _HEEL, _EDGE = 0.12, -0.05, -0.03  # m: where a tilted foot touches the floor, in the ankle's frame
_ALOFT = 0.05  # m: height of the sole from which on a foot is in the air
_LONGEST_LEG = 0.612  # m from the hip roll axis to the ankle; straight it is 0.622, but knees stay bent
_FAR_ALOFT = 0.15  # m: the same where feet are steep, in running and jumping
_SMOOTHING = 9  # frames to either side over which the pelvis gives way to a leg that would be too short
_ROUNDS, _SETTLED = 6, 2  # total iterations, and those after which the pelvis has nearly converged
_OUT_OF_REACH = 1e-3  # m and rad: largest remaining error of a foot on the floor
# Under this vertical force, in units of weight, the zero-moment point is not corrected in full, nor by more than (m).
_FIRM, _FARTHEST = 0.5, 0.08
# An ankle at its limit lets the foot tilt by what is missing (m turn to rad by a lever), and so do frames beside it.
_FOOT, _TILT_GAIN, _TILT_SMOOTHING = 0.15, 1.2, 3
_TOES_UP, _HEEL_UP = -0.35, 0.9  # rad: no further than this
_LAG = 0.5  # by how much of its height a foot in the air may stay behind, in running and jumping
# Above this height (m) a foot may tilt where its ankle ends; then a radian counts as this much (m).
_FREE, _LIFTED_WEIGHT = 0.03, 0.03


class Solver:
    """Solver that turns drafts into balanced poses of a robot.

    Args:
        body: the robot's kinematics.
    """

    def __init__(self, body: WholeBody):
        self.robot = body.robot
        self._body = body
        self._model = body.robot.model()
        default = torch.from_numpy(self.robot.default_qpos)
        self._weight = 9.81 * float(self._model.body_subtreemass[0])
        self._com_height = float(body.center_of_mass(default[None])[0, 2])
        joints = [self.robot.joint_names.index(f"{side}_hip_roll") for side in SIDES]
        hips = [int(self._model.jnt_bodyid[1 + joint]) for joint in joints]  # links have names of their own
        pitch = [self._model.body_pos[self._model.body_parentid[hip]] for hip in hips]
        self._hips = torch.from_numpy(np.stack([self._model.body_pos[h] for h in hips]) + np.stack(pitch))

    def poses(self, draft: Draft) -> np.ndarray:
        """Return the poses ``[F, 7 + J]`` of a draft.

        The inverted pendulum first gives the center of mass, and so the pelvis. The zero-moment point of all bodies is
        then measured, and its error fed through the pendulum again, until it fits.

        Where the draft gives the height of the center of mass, the pendulum's height varies, and in flight the center
        of mass follows its parabola.

        Raises:
            MotionError: when a foot is out of reach.
        """
        feet_pos, feet_quat = _feet(draft)
        lifted = torch.from_numpy(draft.foot_pos[..., 2])
        weight = (1 - lifted / _FREE).clamp_min(_LIFTED_WEIGHT)
        joint_pos = self.robot.default_joint_pos.double().repeat(len(draft.time), 1)
        for index, name in enumerate(self.robot.joint_names):
            if name in draft.channels:
                joint_pos[:, index] = torch.from_numpy(draft.channels[name])
        heading = _turned(2, draft.foot_yaw.mean(-1) + draft.channel("pelvis_yaw"))
        tilt = quat_multiply(_turned(1, draft.channel("pelvis_pitch")), _turned(0, draft.channel("pelvis_roll")))
        root_quat = quat_multiply(heading, tilt)
        wanted_height = self.robot.root_height + draft.channel("pelvis_height")
        if draft.com_rise is not None:
            return self._at_given_height(
                draft, draft.com_rise, root_quat, wanted_height, feet_pos, feet_quat, weight, joint_pos
            )

        pendulum = InvertedPendulum(len(draft.time), self._com_height, DT)
        com = pendulum.com(draft.zmp)
        root_pos = torch.from_numpy(np.column_stack((com, wanted_height)))
        for number in range(_ROUNDS):
            root_pos[:, 2] = torch.from_numpy(self._height_in_reach(root_pos, root_quat, feet_pos, wanted_height))
            joint_pos, pos_off, rot_off = self._body.solve_legs(
                root_pos, root_quat, feet_pos, feet_quat, weight, joint_pos
            )
            qpos = torch.cat((root_pos, root_quat, joint_pos), -1)
            if number >= _SETTLED:
                self._check_reach(joint_pos, lifted, pos_off, rot_off)
                com += pendulum.com(draft.zmp - zero_moment_point(self._model, qpos.numpy(), DT))
            root_pos[:, :2] += torch.from_numpy(com) - self._body.center_of_mass(qpos)[:, :2]
        return qpos.numpy()

    def _at_given_height(
        self,
        draft: Draft,
        rise: np.ndarray,
        root_quat: Tensor,
        wanted_height: np.ndarray,
        feet_pos: Tensor,
        feet_quat: Tensor,
        weight: Tensor,
        joint_pos: Tensor,
    ) -> np.ndarray:
        """Return the poses ``[F, 7 + J]`` whose center of mass rises by ``rise`` ``[F]`` (m) over the first frame."""
        lifted = torch.from_numpy(draft.foot_pos[..., 2])
        rest = torch.tensor([[*draft.zmp[0], wanted_height[0]]], dtype=torch.float64)
        first, _, _ = self._body.solve_legs(rest, root_quat[:1], feet_pos[:1], feet_quat[:1], weight[:1], joint_pos[:1])
        height = float(self._body.center_of_mass(torch.cat((rest, root_quat[:1], first), -1))[0, 2]) + rise
        pendulum = VaryingPendulum(height, DT)
        com = pendulum.com(draft.zmp)
        root_pos = torch.from_numpy(np.column_stack((com, wanted_height[0] + rise)))
        # the moment of a small force says nothing about where it acts
        loaded = (pendulum.load.clip(0, _FIRM) / _FIRM)[:, None]
        for number in range(_ROUNDS):
            joint_pos, pos_off, rot_off = self._body.solve_legs(
                root_pos, root_quat, feet_pos, feet_quat, weight, joint_pos
            )
            qpos = torch.cat((root_pos, root_quat, joint_pos), -1)
            self._tilt_feet(draft, joint_pos, rot_off + pos_off / _FOOT)
            feet_pos, feet_quat = _feet(draft, _FAR_ALOFT)
            if number >= _SETTLED:
                force, moment = ground_reaction(self._model, qpos.numpy(), DT)
                off = draft.zmp - zmp_of(force, moment, qpos.numpy(), least=_FIRM * self._weight)
                com += pendulum.com(loaded * off.clip(-_FARTHEST, _FARTHEST))
            root_pos += torch.from_numpy(np.column_stack((com, height))) - self._body.center_of_mass(qpos)
        joint_pos, pos_off, rot_off = self._body.solve_legs(root_pos, root_quat, feet_pos, feet_quat, weight, joint_pos)
        # what a twisted foot does to the floor is measured afterwards
        self._check_reach(joint_pos, lifted, pos_off, torch.zeros_like(rot_off), lag=_LAG)
        return torch.cat((root_pos, root_quat, joint_pos), -1).numpy()

    def _tilt_feet(self, draft: Draft, joint_pos: Tensor, off: Tensor) -> None:
        """Raise heels and toes in the draft where the ankle's range does not let the foot lie flat."""
        low, high = self.robot.joint_range.double().T
        for index, side in enumerate(SIDES):
            ankle = self.robot.joint_names.index(f"{side}_ankle_pitch")
            excess = off[:, index].numpy() * (draft.foot_pos[:, index, 2] < _ALOFT)
            for sign, limited in ((1, joint_pos[:, ankle] <= low[ankle]), (-1, joint_pos[:, ankle] >= high[ankle])):
                missing = _widened(_TILT_GAIN * excess * limited.numpy(), _TILT_SMOOTHING)
                channel = f"{side}_foot_pitch"
                pitch = draft.channel(channel)
                draft.channels[channel] = (pitch + sign * missing).clip(
                    np.minimum(pitch, _TOES_UP), np.maximum(pitch, _HEEL_UP)
                )

    def _check_reach(
        self, joint_pos: Tensor, lifted: Tensor, pos_off: Tensor, rot_off: Tensor, lag: float = 0.1
    ) -> None:
        beyond = (pos_off > _OUT_OF_REACH + lag * lifted) | ((rot_off > _OUT_OF_REACH) & (lifted <= 0))
        if not beyond.any():
            return
        frame, foot = beyond.nonzero()[0].tolist()
        low, high = self.robot.joint_range.double().T
        at_limit = (joint_pos[frame] <= low) | (joint_pos[frame] >= high)
        names = [name for name, limited in zip(self.robot.joint_names, at_limit.tolist(), strict=True) if limited]
        raise MotionError(f"the {SIDES[foot]} foot is out of reach at frame {frame}, with {names} at their limits")

    def _height_in_reach(self, root_pos: Tensor, root_quat: Tensor, feet_pos: Tensor, wanted: np.ndarray) -> np.ndarray:
        """Return the height of the root ``[F]`` at which no leg is too short, smooth in time."""
        hips = quat_rotate(root_quat[:, None], self._hips)
        aside = (feet_pos - root_pos[:, None] - hips)[..., :2].square().sum(-1)
        highest = feet_pos[..., 2] + (_LONGEST_LEG**2 - aside).clamp_min(0.01).sqrt() - hips[..., 2]
        limit = np.minimum(highest.amin(-1).numpy(), wanted)
        return -_widened(-limit, _SMOOTHING)


def _widened(values: np.ndarray, reach: int) -> np.ndarray:
    """Return a smooth envelope ``[F]`` over values ``[F]``: the largest of ``reach`` frames to both sides, averaged."""
    width = 2 * reach + 1
    largest = np.lib.stride_tricks.sliding_window_view(np.pad(values, reach, mode="edge"), width).max(-1)
    kernel = np.hanning(width + 2)[1:-1]
    return np.convolve(np.pad(largest, reach, mode="edge"), kernel / kernel.sum(), mode="valid")


def _turned(axis: int, angle: np.ndarray) -> Tensor:
    """Return quaternions ``[*B, 4]`` of rotations by ``[*B]`` (rad) about x, y or z."""
    return quat_from_rotvec(torch.from_numpy(angle)[..., None] * torch.eye(3, dtype=torch.float64)[axis])


def _feet(draft: Draft, aloft: float = _ALOFT) -> tuple[Tensor, Tensor]:
    """Return positions ``[F, 2, 3]`` and orientations ``[F, 2, 4]`` of the ankle bodies."""
    pitch = np.stack([draft.channel(f"{side}_foot_pitch") for side in SIDES], -1)
    turn, tilt = _turned(2, draft.foot_yaw), _turned(1, pitch)
    # a foot that lifts its heel turns about the toe, one that lifts its toes about the heel, and one in the air about
    # its middle, for there the pitch goes through 0
    edge = np.where(pitch > 0, _TOE, _HEEL)
    ahead = edge + minimum_jerk(draft.foot_pos[..., 2] / aloft) * (SOLE_CENTER - edge)
    pivot = torch.from_numpy(np.stack((ahead, 0 * ahead, np.full_like(ahead, _EDGE)), -1))
    flat = torch.from_numpy(draft.foot_pos) + torch.tensor([0.0, 0.0, _ANKLE_HEIGHT], dtype=torch.float64)
    return flat + quat_rotate(turn, pivot - quat_rotate(tilt, pivot)), quat_multiply(turn, tilt)
