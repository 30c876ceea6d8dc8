"""A name for the state of the code that makes motions and tables of them."""

import hashlib
from pathlib import Path

__all__ = ["motion_code_digest"]


def motion_code_digest() -> bytes:
    """Hash of every source file that motions and their tables depend on, for caches of them.

    >>> len(motion_code_digest())
    16
    """
    motions = Path(__file__).parent
    envs, plat = motions.parents[:2]
    files = [*motions.rglob("*.py"), *motions.rglob("*.yaml")]
    files += [envs / "kinematics.py", envs / "robot.py", plat / "rotations.py"]
    digest = hashlib.blake2b(digest_size=16)
    for file in sorted(files):
        digest.update(hashlib.blake2b(file.read_bytes()).digest())
    return digest.digest()
