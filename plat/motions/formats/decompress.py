"""Undoes the compression that joblib writes, up to a limit."""

import bz2
import lzma
import zlib

from plat.errors import MotionError

__all__ = ["check_numbers", "decompress", "size_limit"]

_GENEROUS = 64 << 20
_MOST_RATIO = 20
# Numbers become eight bytes each, and what looks at them takes several times that. An hour at 60 Hz is 8 million.
_GENEROUS_NUMBERS = 8 << 20
_MOST_NUMBERS_A_BYTE = 10

_DECOMPRESSORS = (
    (b"\x1f\x8b", lambda: zlib.decompressobj(wbits=31)),
    (b"\x78", zlib.decompressobj),
    (b"BZh", bz2.BZ2Decompressor),
    (b"\xfd7zXZ", lambda: lzma.LZMADecompressor(memlimit=_GENEROUS)),
    (b"\x5d\x00", lambda: lzma.LZMADecompressor(memlimit=_GENEROUS)),
)


def size_limit(compressed: int) -> int:
    """Return the largest content (bytes) that is believed of a compressed file: bombs grow a thousandfold.

    >>> size_limit(1000) >> 20
    64
    """
    return max(_GENEROUS, _MOST_RATIO * compressed)


def check_numbers(numbers: int, compressed: int) -> None:
    """Raise for more numbers than a file of a size is believed to hold, such as an hour of zeros in a few kilobytes.

    Args:
        numbers: in its motions.
        compressed: bytes of the file.

    Raises:
        MotionError: for more than ten a byte, and more than an hour at 60 Hz.

    >>> check_numbers(36 * 1000, compressed=2000)
    """
    if numbers > max(_GENEROUS_NUMBERS, _MOST_NUMBERS_A_BYTE * compressed):
        raise MotionError(
            f"it unpacks to {numbers / 1e6:.0f} million numbers, expected motions: no recording shrinks so much"
        )


def decompress(data: bytes) -> bytes:
    """Return the content of a zlib, gzip, bz2, xz or lzma stream; data that is none of these comes back as it is.

    Raises:
        MotionError: when the stream ends too early, or holds more than :func:`size_limit`.

    >>> decompress(zlib.compress(b"motion"))
    b'motion'
    """
    for magic, make in _DECOMPRESSORS:
        if data.startswith(magic):
            decompressor = make()
            limit = size_limit(len(data))
            content: bytes = decompressor.decompress(data, limit + 1)
            if len(content) > limit:
                raise MotionError(f"it unpacks to more than {limit} bytes, expected a motion")
            if not decompressor.eof:
                raise MotionError("its compressed content ends too early")
            return content
    if data.startswith(b"\x04\x22\x4d\x18"):
        raise MotionError("it is compressed with lz4, expected zlib, gzip, bz2, xz, lzma or no compression")
    return data
