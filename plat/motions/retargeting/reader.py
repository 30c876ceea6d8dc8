"""Human motion capture, retargeted as it is read."""

from pathlib import Path

from plat.errors import MotionError
from plat.motions.formats import MotionFile, ReadOptions
from plat.motions.retargeting.retarget import retarget

__all__ = ["read_human_motion"]


def read_human_motion(path: Path, options: ReadOptions) -> MotionFile:
    """Return the motion of the robot that :func:`plat.motions.retargeting.retarget` makes of a ``.bvh``.

    Raises:
        MotionError: when it is broken, of a skeleton that no map that comes with plat fits, or the extra that
            retargets is not installed.
    """
    if options.fps is not None:
        raise MotionError(f"'fps' stated as {options.fps:g}, but a .bvh gives its own 'Frame Time'")
    try:
        made = retarget(path, robot=options.robot)
    except MotionError as error:
        raise MotionError(str(error).removeprefix(f"BVH file {str(path)!r}").lstrip(":, ")) from None
    return MotionFile(path, "human BVH, retargeted", [made.clip], (f"{100 * made.error:.1f} cm off its targets",))
