"""Running an exported policy on a robot or in another simulator: needs numpy, and onnxruntime for the network."""

from plat.deploy.description import Body, RobotDescription
from plat.deploy.kinematics import KeypointKinematics
from plat.deploy.observation import ObservationBuilder, Term, observation_terms
from plat.deploy.state import Pose, RobotState

__all__ = [
    "Body",
    "KeypointKinematics",
    "ObservationBuilder",
    "Pose",
    "RobotDescription",
    "RobotState",
    "Term",
    "observation_terms",
]
