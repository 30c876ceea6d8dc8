"""Store of clips that were read: in memory, and behind a limit in temporary files that are memory-mapped."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from plat.motions.formats import MotionFile

__all__ = ["ClipStore"]

_SEGMENT = 1 << 28
_ZEROS = bytes(1 << 20)


class ClipStore:
    """Store of clips. Files behind the limit vanish with the last clip, and a full disk means that memory is used.

    Args:
        folder: where temporary files go.
        in_memory: size of what stays in memory (bytes).
        segment: size of a temporary file (bytes); a longer clip has its own.

    >>> from plat.motions import MotionClip
    >>> clip = MotionClip("a", np.ones((4, 36)), 30.0)
    >>> kept = ClipStore(Path(tempfile.gettempdir()), in_memory=0).keep(clip.qpos)
    >>> bool((kept == clip.qpos).all())
    True
    """

    def __init__(self, folder: Path, in_memory: int = 1 << 29, segment: int = _SEGMENT):
        self._folder = folder
        self._left = in_memory
        self._size = segment
        self._segment = np.empty(0, np.uint8)
        self._used = 0
        self._full = False

    def __call__(self, file: MotionFile) -> MotionFile:
        """Return the file with its clips where they are kept."""
        return replace(file, clips=[replace(clip, qpos=self.keep(clip.qpos)) for clip in file.clips])

    def keep(self, qpos: np.ndarray) -> np.ndarray:
        """Return an equal array, which may be in a file."""
        qpos = np.asarray(qpos)
        if self._full or self._left >= qpos.nbytes or qpos.dtype.kind not in "fiu":
            self._left -= qpos.nbytes
            return qpos
        if self._used + qpos.nbytes > len(self._segment):
            try:
                self._segment, self._used = self._new_segment(max(self._size, qpos.nbytes)), 0
            except OSError:
                self._full = True
                return qpos
        place = self._segment[self._used : self._used + qpos.nbytes].view(qpos.dtype).reshape(qpos.shape)
        place[...] = qpos
        self._used += -(-qpos.nbytes // 64) * 64
        return place

    def _new_segment(self, size: int) -> np.ndarray:
        self._folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=self._folder) as file:
            # written, for a map of a file with holes ends the process when the disk is full
            for begin in range(0, size, len(_ZEROS)):
                file.write(_ZEROS[: size - begin])
            file.flush()
            return np.memmap(file, np.uint8, "r+", shape=(size,))
