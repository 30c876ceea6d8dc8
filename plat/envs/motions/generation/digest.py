"""A name for the state of the code that makes the motions."""

import hashlib
from importlib import resources

__all__ = ["generator_digest"]


def generator_digest() -> bytes:
    """Hash of every source file that the generated motions depend on, for caches of what they give.

    >>> len(generator_digest())
    16
    """
    package = resources.files("plat.envs.motions.generation")
    files = [file for folder in (package, package / "families") for file in folder.iterdir() if file.is_file()]
    files += [resources.files("plat.envs") / name for name in ("kinematics.py", "robot.py", "motions/collision.py")]
    files.append(resources.files("plat") / "rotations.py")
    digest = hashlib.blake2b(digest_size=16)
    for file in sorted(files, key=str):
        digest.update(hashlib.blake2b(file.read_bytes()).digest())
    return digest.digest()
