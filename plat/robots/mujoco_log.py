"""MuJoCo's log file: not beside the user's files."""

import mujoco

__all__ = ["leave_no_log_file"]


def leave_no_log_file() -> None:
    """Keep MuJoCo from appending its warnings to ``MUJOCO_LOG.TXT`` in the current folder.

    They stay on standard error. A log file of another name is the user's wish and is kept.

    >>> leave_no_log_file()
    """
    kind = getattr(mujoco, "MjLogConfig", None)
    if kind is None:  # older MuJoCos, which other pools of simulations come with
        return
    config = kind.get()
    if config.logfile == "MUJOCO_LOG.TXT":
        config.logto_file = False
        config.set()
