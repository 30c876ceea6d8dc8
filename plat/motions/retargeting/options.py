"""Settings of inverse kinematics, apart from it so that a command line can show them without mink."""

from dataclasses import dataclass

__all__ = ["SolverOptions"]


@dataclass(frozen=True)
class SolverOptions:
    """How inverse kinematics is done."""

    iterations: int = 4
    """steps of inverse kinematics a frame"""
    first_frame_iterations: int = 60
    """steps of it for the first frame, which starts from the default pose"""
    max_joint_speed: float = 15.0
    """fastest that a joint may turn (rad/s)"""
