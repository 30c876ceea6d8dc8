"""Errors that say what was wrong, where, and what would be right."""

__all__ = [
    "ActionError",
    "BundleError",
    "CheckpointError",
    "ConfigError",
    "KeyframeError",
    "MotionError",
    "ObservationError",
    "PlatError",
    "RecordsError",
    "RenderingError",
    "RobotError",
    "StateError",
    "StudioError",
    "TaskError",
]


class PlatError(ValueError):
    """Base class of every error that plat raises about its input."""


class MotionError(PlatError):
    """A motion file or clip that cannot be used as it is."""


class ObservationError(PlatError):
    """An entry of an observation that does not exist, or that nothing computes."""


class KeyframeError(PlatError):
    """A keyframe file or sequence that cannot be used as it is."""


class RobotError(PlatError):
    """A robot description that does not have what plat needs."""


class CheckpointError(PlatError):
    """A run directory or checkpoint that cannot be read or does not fit."""


class ActionError(PlatError):
    """A policy whose actions, or whose observations, are not finite."""


class ConfigError(PlatError):
    """A setting, or a combination of settings, that makes no sense."""


class BundleError(PlatError):
    """An exported policy that cannot be made, read, or used with this robot."""


class StateError(PlatError):
    """A robot state or pose that no policy can act on."""


class StudioError(PlatError):
    """The keyframe studio cannot be opened."""


class RenderingError(PlatError):
    """This machine cannot draw."""


class RecordsError(PlatError):
    """Records of an evaluation that cannot be read."""


class TaskError(PlatError):
    """An environment whose rewards, transforms or settings do not fit together."""
