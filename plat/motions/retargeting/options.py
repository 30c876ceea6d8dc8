"""Settings of inverse kinematics, apart from it so that a command line can show them without mink."""

from dataclasses import dataclass

from plat.bounds import Bounded, Count, Positive

__all__ = ["SolverOptions"]


@dataclass(frozen=True)
class SolverOptions(Bounded):
    """How inverse kinematics is done."""

    iterations: Count = 4
    """steps of inverse kinematics a frame"""
    first_frame_iterations: Count = 60
    """steps of it for the first frame, which starts from the default pose"""
    max_joint_speed: Positive = 15.0
    """fastest that a joint may turn (rad/s)"""
