"""Errors that say what was wrong, where, and what would be right."""

__all__ = [
    "ActionError",
    "BundleError",
    "CheckpointError",
    "ConfigError",
    "KeyframeError",
    "MotionError",
    "ObservationError",
    "OutputError",
    "PlatError",
    "RecordsError",
    "RenderingError",
    "RobotError",
    "StateError",
    "StudioError",
    "TaskError",
    "WorkerError",
]


class PlatError(ValueError):
    """Base class of every error that plat raises about its input."""


class MotionError(PlatError):
    """Motion file or clip that cannot be used as it is."""


class ObservationError(PlatError):
    """Entry of an observation that does not exist, or that nothing computes."""


class KeyframeError(PlatError):
    """Keyframe file or sequence that cannot be used as it is."""


class RobotError(PlatError):
    """Robot description that lacks what plat needs."""


class CheckpointError(PlatError):
    """Run directory or checkpoint that cannot be read or does not fit."""


class ActionError(PlatError):
    """Actions or observations of a policy that are not finite."""


class ConfigError(PlatError):
    """Setting, or combination of settings, that makes no sense."""


class BundleError(PlatError):
    """Exported policy that cannot be made, read, or used with this robot."""


class StateError(PlatError):
    """Robot state or pose that no policy can act on."""


class StudioError(PlatError):
    """Keyframe studio that cannot be opened."""


class RenderingError(PlatError):
    """Picture or video that cannot be made: no OpenGL, no encoder, or a file that cannot be written."""


class OutputError(PlatError):
    """File or folder that cannot be written."""


class RecordsError(PlatError):
    """Records of an evaluation that cannot be read."""


class TaskError(PlatError):
    """Environment whose rewards, transforms or settings do not fit together."""


class WorkerError(PlatError):
    """Worker process, or cluster of them, that cannot be started or kept running."""
