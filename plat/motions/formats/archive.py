"""NumPy archives, read without running what may be in them."""

import math
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.motions.formats.decompress import size_limit
from plat.motions.formats.unpickle import PickledArray, unpickle

__all__ = ["read_archive"]


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
                if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise MotionError(f"{entry.filename!r} is compressed in a way that NumPy does not use")
                with archive.open(entry) as member:
                    # reading up to a size, and not to the end, holds a member to the size that it claims
                    data = member.read(entry.file_size + 1)
                    try:
                        arrays[entry.filename.removesuffix(".npy")] = _array(data)
                    except MotionError as error:
                        raise MotionError(f"array {entry.filename.removesuffix('.npy')!r}: {error}") from None
    return arrays


def _array(data: bytes) -> np.ndarray:
    """An ``.npy`` file; its header cannot ask for more memory than there are bytes."""
    stream = BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read_header(stream)
    if dtype.hasobject:
        content = unpickle(data[stream.tell() :])
        if not isinstance(content, PickledArray) or content.value is None:
            raise MotionError("an array holds Python objects, expected numbers or texts")
        return content.value
    if math.prod(shape) * dtype.itemsize != len(data) - stream.tell():
        raise MotionError(f"an array of shape {shape} does not have the bytes for it")
    return np.frombuffer(data, dtype, offset=stream.tell()).reshape(shape, order="F" if fortran else "C")
