"""Frame rates of tables that do not state theirs, from the same motion in another format beside them."""

from pathlib import Path
from typing import Any

import numpy as np

from plat.errors import MotionError
from plat.motions.formats.archive import read_archive, take_rates
from plat.motions.formats.clock import StatedRate, rates_of_fields
from plat.motions.formats.decompress import decompress
from plat.motions.formats.plat_file import ASSUMED
from plat.motions.formats.unpickle import PickledArray, unpickle

__all__ = ["rates_beside"]

# A conversion may leave out a frame at either end.
_FRAMES_OFF = 2


def rates_beside(path: Path, frames: int) -> list[StatedRate]:
    """Return the frame rates that an ``.npz`` or ``.pkl`` of the same name with as many frames states, if any does.

    Args:
        path: of the table.
        frames: that it has.
    """
    for ending, read in ((".npz", _archive), (".pkl", _pickle)):
        beside = path.with_suffix(ending)
        if beside.is_file():
            try:
                rates, count = read(beside)
            except Exception:  # whatever is wrong with it: it is not the file that was asked for
                continue
            if abs(count - frames) <= _FRAMES_OFF:
                return [(rate, f"{beside.name} beside it") for rate, _ in rates]
    return []


def _archive(path: Path) -> tuple[list[StatedRate], int]:
    arrays = read_archive(path)
    if ASSUMED in arrays:
        raise MotionError("its own rate was assumed")  # for this very table, where it was made of it
    return take_rates(arrays, None), next(len(array) for array in arrays.values() if array.ndim > 1)


def _pickle(path: Path) -> tuple[list[StatedRate], int]:
    fields: Any = unpickle(decompress(path.read_bytes()))
    if all(isinstance(value, dict) for value in fields.values()):
        (fields,) = fields.values()  # joblib's dictionary of motions, of which there is one
    values = {name: value.value if isinstance(value, PickledArray) else value for name, value in fields.items()}
    length = next((len(value) for value in values.values() if isinstance(value, np.ndarray) and value.ndim > 1), None)
    if length is None:
        raise MotionError("no frames")
    return rates_of_fields(values), length
