"""Running an exported policy on a robot or in another simulator. Needs numpy, and onnxruntime for the network."""

from plat.deploy.bundle import Bundle, BundleScore, PolicyFacts, TrainingFacts
from plat.deploy.contact_detection import ContactDetector, ContactSettings
from plat.deploy.description import Body, Foot, RobotDescription
from plat.deploy.estimator import EstimatorSettings, StateEstimator
from plat.deploy.invariant_filter import FilterNoise, InvariantFilter
from plat.deploy.kinematics import KeypointKinematics
from plat.deploy.observation import ObservationBuilder, ObservationTerm, observation_terms
from plat.deploy.runner import JointCommand, PolicyRunner
from plat.deploy.soles import SoleKinematics
from plat.deploy.state import Pose, RobotState

__all__ = [
    "Body",
    "Bundle",
    "BundleScore",
    "ContactDetector",
    "ContactSettings",
    "EstimatorSettings",
    "FilterNoise",
    "Foot",
    "InvariantFilter",
    "JointCommand",
    "KeypointKinematics",
    "ObservationBuilder",
    "ObservationTerm",
    "PolicyFacts",
    "PolicyRunner",
    "Pose",
    "RobotDescription",
    "RobotState",
    "SoleKinematics",
    "StateEstimator",
    "TrainingFacts",
    "observation_terms",
]
