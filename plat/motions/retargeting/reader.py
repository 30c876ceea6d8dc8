"""Human motion capture, retargeted as it is read."""

from pathlib import Path

from plat.errors import MotionError
from plat.motions.formats import MotionFile, ReadOptions
from plat.motions.retargeting.retarget import TURNED, retarget

__all__ = ["read_human_motion"]


def read_human_motion(path: Path, options: ReadOptions) -> MotionFile:
    """Return the motion of the robot that :func:`plat.motions.retargeting.retarget` makes of a capture.

    Raises:
        MotionError: when it is broken, of a skeleton that no map that comes with plat fits, or the extra that
            retargets is not installed.
    """
    try:
        made = retarget(
            path, robot=options.robot, fps=options.fps, up=options.up, units=options.units, angles=options.angles
        )
    except MotionError as error:
        told = str(error).removeprefix(f"{path.suffix[1:].upper()} file {str(path)!r}").lstrip(":, ")
        raise MotionError(told) from None
    kind = f"human {path.suffix[1:].upper()}, retargeted"
    unheard = ("quat_order",) if path.suffix.lower() in TURNED else ("quat_order", "angles")
    return MotionFile(path, kind, [made.clip], (f"{100 * made.error:.1f} cm off its targets",), unheard)
