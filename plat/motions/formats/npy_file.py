"""Single NumPy arrays: a table of numbers, or a dictionary of fields."""

from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.motions.formats.archive import read_array
from plat.motions.formats.common import MotionFile, ReadOptions
from plat.motions.formats.csv_file import read_values
from plat.motions.formats.decompress import check_numbers
from plat.motions.formats.foreign import refuse_bare_joints
from plat.motions.formats.pickle_file import read_fields
from plat.motions.formats.text_tables import Table

__all__ = ["read_npy"]


def read_npy(path: Path, options: ReadOptions) -> MotionFile:
    """Read ``.npy``: columns as in a table without a header, or what ``np.save`` makes of a dictionary of fields.

    Raises:
        MotionError: for an array of another shape, or objects that are no fields of a motion.
    """
    data = path.read_bytes()
    found = read_array(data)
    if isinstance(found, dict):
        return read_fields(path, found, options, len(data), len(data))
    if found is None or found.ndim != 2 or found.dtype.kind not in "fiu":
        shape = "what is no numbers" if found is None else f"an array of shape {found.shape} and type {found.dtype}"
        refuse_bare_joints(found)
        raise MotionError(
            f"it holds {shape}, expected (frames, {7 + options.robot.num_joints}) numbers, or fields of a motion"
        )
    check_numbers(found.size, len(data))
    return read_values(path, Table([], np.array(found, dtype=np.float64), []), options, "npy")
