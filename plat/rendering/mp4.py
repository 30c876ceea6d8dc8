"""Whether an MP4 file was written to its end."""

import os
from pathlib import Path

__all__ = ["is_whole"]

_LONG, _TO_THE_END = 1, 0
"""Sizes of a box with a meaning of their own: eight bytes of size follow, or the box is the last one."""


def is_whole(path: Path) -> bool:
    """Return whether a file is an MP4 whose boxes are all there, with the index of its pictures.

    An encoder whose disk is full leaves a file without one, which no player opens, and may not say so.
    """
    size = os.path.getsize(path)
    kinds, at = set(), 0
    with path.open("rb") as file:
        while at < size:
            file.seek(at)
            header = file.read(16)
            if len(header) < 8:
                return False
            length, kind = int.from_bytes(header[:4], "big"), header[4:8]
            if length == _LONG:
                length = int.from_bytes(header[8:16], "big")
            elif length == _TO_THE_END:
                length = size - at
            if length < 8:
                return False
            kinds.add(kind)
            at += length
    return at == size and {b"ftyp", b"moov", b"mdat"} <= kinds
