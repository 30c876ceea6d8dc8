"""Last line of defense between a policy and the motors: small pieces, and a runner that puts them together."""

from plat.deploy.safety.ending import CommandSource, EndOfSequence, TimedCommand
from plat.deploy.safety.followable import FollowableCommands
from plat.deploy.safety.journal import Intervention, Journal
from plat.deploy.safety.limits import TargetLimiter
from plat.deploy.safety.onboard import OnboardController, OnboardReading
from plat.deploy.safety.ramp import Ramp
from plat.deploy.safety.safe_runner import MotorPolicy, SafeRunner
from plat.deploy.safety.settings import SafetySettings
from plat.deploy.safety.stops import stop_reason
from plat.deploy.safety.watch import StateWatch

__all__ = [
    "CommandSource",
    "EndOfSequence",
    "FollowableCommands",
    "Intervention",
    "Journal",
    "MotorPolicy",
    "OnboardController",
    "OnboardReading",
    "Ramp",
    "SafeRunner",
    "SafetySettings",
    "StateWatch",
    "TargetLimiter",
    "TimedCommand",
    "stop_reason",
]
