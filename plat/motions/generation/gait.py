"""Footsteps: alternating steps with the weight shifts between them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plat.motions.generation.script import RIGHT, SIDES, MotionScript

__all__ = ["Gait", "take_steps"]


@dataclass(frozen=True)
class Gait:
    """Parameters of a gait."""

    step_time: float
    """seconds per step"""
    double_support: float = 0.3
    """fraction of a step with both feet on the floor"""
    clearance: float = 0.05
    """height of the swinging sole in mid-swing (m)"""
    roll: float = 0.0
    """distance that the weight rolls forward under the stance foot (m)"""
    heel_off: float = 0.0
    """pitch of the foot at lift-off (rad)"""
    toes_up: float = 0.0
    """pitch of the foot at landing, in the opposite direction (rad)"""
    onset: float = 0.6
    """duration of the initial weight shift onto the stance foot, and of the final one back between the feet (s)"""


def take_steps(script: MotionScript, steps: Sequence[tuple[int, np.ndarray]], gait: Gait) -> None:
    """Write footsteps, from standing to standing; time advances to their end.

    A step begins with double support, in which the weight shifts onto the stance foot; then the other foot swings.
    With ``heel_off`` and ``toes_up`` feet roll: the heel rises once the weight is on the toes, and the sole comes down
    after the heel has landed.

    Args:
        script: script to write to.
        steps: the foot (0 left, 1 right) and its new place: x, y (m) and yaw (rad) ``[3]``.
        gait: parameters.
    """
    shift, last = gait.double_support * gait.step_time, len(steps) - 1
    for number, (foot, place) in enumerate(steps):
        support = gait.onset if number == 0 else shift
        swing = gait.step_time - shift
        standing = 1.0 if foot != RIGHT else 0.0
        # no roll in the first and last step, where the speed is low
        back, ahead = (0.0 if number == end else 0.5 * gait.roll for end in (0, last))
        script.weigh(script.under(standing, -back), support)
        script.weigh(script.under(standing, ahead), swing, support)
        channel = f"{SIDES[foot]}_foot_pitch"
        if gait.heel_off and number > 0:
            script.move({channel: gait.heel_off}, 1.1 * shift, 0.35 * shift)
        if gait.heel_off or gait.toes_up:
            landing = -gait.toes_up if number < last - 1 else 0.0
            script.move({channel: landing}, 0.75 * swing, support + 0.25 * swing)
            script.move({channel: 0.0}, 0.8 * shift, support + swing)
        script.step(foot, place, swing, gait.clearance, support)
        script.wait(support + swing)
    script.weigh(script.under(0.5), gait.onset)
    script.wait(gait.onset)
