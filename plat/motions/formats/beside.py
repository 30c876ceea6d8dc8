"""Frame rates of tables that do not state theirs, from the same motion in another format beside them."""

from pathlib import Path
from typing import Any

import numpy as np

from plat.errors import MotionError
from plat.motions.formats.archive import read_archive, take_rate
from plat.motions.formats.common import number
from plat.motions.formats.decompress import decompress
from plat.motions.formats.unpickle import PickledArray, unpickle

__all__ = ["rate_beside"]

# A conversion may leave out a frame at either end.
_FRAMES_OFF = 2


def rate_beside(path: Path, frames: int) -> tuple[float, str] | None:
    """Return the frame rate of an ``.npz`` or ``.pkl`` of the same name with as many frames, and its source; or None.

    Args:
        path: of the table.
        frames: that it has.
    """
    for ending, read in ((".npz", _archive), (".pkl", _pickle)):
        beside = path.with_suffix(ending)
        if beside.is_file():
            try:
                rate, count = read(beside)
            except Exception:  # whatever is wrong with it: it is not the file that was asked for
                continue
            if abs(count - frames) <= _FRAMES_OFF:
                return rate, f"{beside.name} beside it"
    return None


def _archive(path: Path) -> tuple[float, int]:
    arrays = read_archive(path)
    rate = take_rate(arrays, None)
    return rate, next(len(array) for array in arrays.values() if array.ndim > 1)


def _pickle(path: Path) -> tuple[float, int]:
    fields: Any = unpickle(decompress(path.read_bytes()))
    if "fps" not in fields:
        (fields,) = fields.values()  # joblib's dictionary of motions, of which there is one
    values = {name: value.value if isinstance(value, PickledArray) else value for name, value in fields.items()}
    length = next((len(value) for value in values.values() if isinstance(value, np.ndarray) and value.ndim > 1), None)
    if length is None:
        raise MotionError("no frames")
    return number(values["fps"], "fps"), length
