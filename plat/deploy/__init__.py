"""Running an exported policy on a robot or in another simulator. Needs numpy, and onnxruntime for the network."""

from plat.deploy.bundle import Bundle, BundleScore, PolicyFacts, TrainingFacts
from plat.deploy.description import Body, RobotDescription
from plat.deploy.kinematics import KeypointKinematics
from plat.deploy.observation import ObservationBuilder, ObservationTerm, observation_terms
from plat.deploy.runner import JointCommand, PolicyRunner
from plat.deploy.state import Pose, RobotState

__all__ = [
    "Body",
    "Bundle",
    "BundleScore",
    "JointCommand",
    "KeypointKinematics",
    "ObservationBuilder",
    "ObservationTerm",
    "PolicyFacts",
    "PolicyRunner",
    "Pose",
    "RobotDescription",
    "RobotState",
    "TrainingFacts",
    "observation_terms",
]
