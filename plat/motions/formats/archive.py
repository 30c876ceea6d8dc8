"""NumPy archives, read without running what may be in them."""

import math
import zipfile
from collections.abc import Collection
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np

from plat.errors import MotionError
from plat.json_file import short
from plat.motions.formats.clock import (
    STATED,
    StatedRate,
    contradiction,
    distinct_rates,
    rate_fields,
    rates_of_fields,
    stated_rates,
    tells_time,
)
from plat.motions.formats.decompress import check_numbers, size_limit
from plat.motions.formats.plat_file import RATE, is_marked
from plat.motions.formats.unpickle import PickledArray, unpickle

__all__ = ["archive_shapes", "read_archive", "read_array", "states_rate", "take_rate", "take_rates"]

# arrays of Python objects that describe a motion and are not needed to read it
_DESCRIPTIONS = frozenset(("metadata", "meta", "info", "config", "obs_container"))


def read_archive(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an ``.npz``, none larger than the archive makes believable.

    Arrays of Python objects are read without running them where they hold text or numbers.

    Raises:
        MotionError: for an archive that holds something else, or more than it seems to.
    """
    arrays = {}
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > size_limit(path.stat().st_size):
            raise MotionError("it unpacks to far more than its size, expected motions")
        for entry in archive.infolist():
            if entry.filename.endswith(".npy"):
                name = entry.filename.removesuffix(".npy")
                if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise MotionError(f"{short(entry.filename)} is compressed in a way that NumPy does not use")
                with archive.open(entry) as member:
                    # reading up to a size, and not to the end, holds a member to the size that it claims
                    data = member.read(entry.file_size + 1)
                    try:
                        array = read_array(data)
                        if isinstance(array, dict):
                            raise MotionError("it holds an array with Python objects, expected numbers or texts")
                    except MotionError as error:
                        if name in _DESCRIPTIONS:
                            continue
                        raise MotionError(f"array {short(name)}: {error}") from None
                    if array is not None:
                        arrays[name] = array
    check_numbers(sum(array.size for array in arrays.values()), path.stat().st_size)
    return arrays


def archive_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the arrays of an ``.npz`` by name, from their headers; nothing for a broken one."""
    shapes = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                if entry.filename.endswith(".npy"):
                    with archive.open(entry) as member:
                        shapes[entry.filename.removesuffix(".npy")] = _header(member)[0]
    except Exception:  # whatever a broken file does: its reader says what is wrong
        return {}
    return shapes


def states_rate(arrays: Collection[str]) -> bool:
    """Return whether one of the arrays gives the frames a second."""
    return bool(rate_fields(arrays))


def take_rate(arrays: dict[str, np.ndarray], fps: float | None, path: Path | None = None) -> StatedRate:
    """Take the frames a second out of the arrays, with what states them; see :func:`take_rates`.

    Raises:
        MotionError: when nothing states it, or arrays contradict each other.
    """
    rates = take_rates(arrays, fps, path)
    if len(rates) > 1:
        raise contradiction(rates)
    return rates[0]


def take_rates(arrays: dict[str, np.ndarray], fps: float | None, path: Path | None = None) -> list[StatedRate]:
    """Take the frames a second out of the arrays: all that they state, and one at least.

    Args:
        arrays: of an archive, by name.
        fps: where the user states it.
        path: of the archive, whose name counts where no array states it.

    Raises:
        MotionError: when nothing states it.
    """
    marked = is_marked(arrays)  # its other arrays are clips
    fields = {name: array for name, array in arrays.items() if name == RATE or not marked}
    rates = rates_of_fields(fields) if fps is None else [(fps, STATED)]
    if not rates and path is not None:
        rates = distinct_rates(stated_rates(path, []))
    if not rates:
        raise MotionError("no array 'fps', expected the frames a second (or state them: plat motions convert --fps)")
    times = [name for name, array in arrays.items() if array.ndim == 1 and tells_time(name)]
    for name in (RATE,) if marked else (*(name for name in rate_fields(arrays) if arrays[name].ndim < 2), *times):
        arrays.pop(name, None)
    return rates


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    return read(stream)


def read_array(data: bytes) -> np.ndarray | dict[Any, Any] | None:
    """Return what an ``.npy`` file holds: numbers or texts, a dictionary that ``np.save`` put into an array, or None.

    Its header cannot ask for more memory than there are bytes, and nothing in it is run.

    Raises:
        MotionError: for other objects, or an array without the bytes for it.
    """
    stream = BytesIO(data)
    shape, fortran, dtype = _header(stream)
    if dtype.hasobject:
        content = unpickle(data[stream.tell() :])
        if isinstance(content, PickledArray) and isinstance(content.value, dict):
            return content.value
        if isinstance(content, PickledArray) and content.value is not None and content.value.size == 0:
            return None
        if not isinstance(content, PickledArray) or content.value is None:
            raise MotionError("it holds an array with Python objects, expected numbers or texts")
        return content.value
    if dtype.kind == "c":
        raise MotionError("it holds complex numbers, expected real ones")
    if dtype.kind not in "biufSU":
        return None  # no motion: a table of something, or dates
    # rows of no columns and texts of no letters take no bytes, and a thousand million of them are claimed as easily
    if math.prod(shape) * dtype.itemsize != len(data) - stream.tell() or max(shape, default=0) > len(data):
        raise MotionError(f"an array of shape {short(shape)} does not have the bytes for it")
    return np.frombuffer(data, dtype, offset=stream.tell()).reshape(shape, order="F" if fortran else "C")
