"""Contact detection without force sensors: which points of the soles stand on the floor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plat.bounds import Bounded, NonNegative, Positive
from plat.deploy.description import RobotDescription
from plat.deploy.soles import SoleKinematics

__all__ = ["ContactDetector", "ContactSettings"]

# What a foot bears that stands (N), of a robot that weighs so much (kg): the G1.
_FORCE, _MASS = 60.0, 33.34
# Regularization of the force in a straight leg, whose Jacobian is singular (m).
_DAMPING = 0.02


@dataclass(frozen=True)
class ContactSettings(Bounded):
    """Settings of contact detection."""

    height: Positive = 0.008
    """a point in contact is at most this much above the lowest one (m)"""
    speed: Positive = 0.25
    """and at most this much faster than the slowest one (m/s)"""
    force: NonNegative | None = None
    """and its foot bears at least this, where torques are measured (N); None: 60 N of a robot of 33 kg"""
    steps: NonNegative = 2
    """a point is in contact once this many updates in a row say so"""


class ContactDetector:
    """Detector of contacts between soles and floor, from joint angles, velocities and torques.

    Three cues, and all must agree: a point is low, it is slow, and its foot bears weight. Weight is the static force
    ``f`` with ``J^T f = -torque`` for the joints of the leg. Camurri et al., "Probabilistic contact estimation and
    impact detection for state estimation of quadruped robots", 2017, use the same force.

    Args:
        robot: gives the joints of the legs.
        settings: thresholds.
    """

    def __init__(self, robot: RobotDescription, settings: ContactSettings = ContactSettings()):
        soles = SoleKinematics(robot)
        self._foot, self._legs = soles.foot, soles.legs
        self._settings = settings
        # others bear in proportion; a description of version 0.2 or before has no mass and is taken for that of a G1
        weighed = _FORCE if robot.mass is None else _FORCE * robot.mass / _MASS
        self._force = weighed if settings.force is None else settings.force
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._streak = np.zeros(len(self._foot), dtype=np.int64)

    def __call__(
        self,
        points_w: NDArray[np.float64],
        velocity_w: NDArray[np.float64],
        jacobian_w: NDArray[np.float64],
        torque: NDArray[np.floating] | None = None,
    ) -> NDArray[np.bool_]:
        """Return which points are in contact ``[P]``.

        Args:
            points_w: points of the soles relative to the root ``[P, 3]`` (m), axes of the world.
            velocity_w: their velocities ``[P, 3]`` (m/s, world).
            jacobian_w: their Jacobians ``[P, 3, J]`` (m/rad), axes of the world.
            torque: measured joint torques ``[J]`` (N m); None where there are none.
        """
        limits = self._settings
        height = points_w[:, 2] - points_w[:, 2].min()
        low = height <= limits.height
        speed = np.linalg.norm(velocity_w, axis=1)
        touches = low & (speed <= speed[low].min() + limits.speed)
        if torque is not None:
            touches &= self.forces(jacobian_w, torque)[self._foot] >= self._force
        self._streak = np.where(touches, self._streak + 1, 0)
        return self._streak >= limits.steps

    def forces(self, jacobian_w: NDArray[np.float64], torque: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the vertical force under each foot (N), as if the legs were light and slow.

        Args:
            jacobian_w: Jacobians of the points of the soles ``[P, 3, J]``, axes of the world.
            torque: joint torques ``[J]`` (N m).
        """
        forces = []
        for foot, leg in enumerate(self._legs):
            jacobian = jacobian_w[self._foot == foot].mean(0)[:, leg]
            square = jacobian @ jacobian.T + _DAMPING**2 * np.eye(3)
            forces.append(-np.linalg.solve(square, jacobian @ torque[leg])[2])
        return np.array(forces)
