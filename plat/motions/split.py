"""Split of a data set into train, validation and test clips by name alone."""

import hashlib
from typing import Literal

__all__ = ["Split", "split_of"]

Split = Literal["train", "val", "test"]


def split_of(name: str) -> Split:
    """Return the split of a clip: SHA-256 of its name modulo 100: 0 to 9 test, 10 to 19 val, the rest train.

    The name is the motion capture file's without folder and ending, so that anyone who has the files has the split.

    >>> [split_of(f"dataset-2_walk_normal_{take:03d}") for take in (1, 2, 3)]
    ['train', 'train', 'train']
    """
    remainder = int.from_bytes(hashlib.sha256(name.encode()).digest(), "big") % 100
    if remainder < 10:
        return "test"
    return "val" if remainder < 20 else "train"
