"""Bins of about a second of motion: where episodes start, and where they failed."""

import torch
from torch import Tensor, nn

from plat.motions.library import MotionLibrary

__all__ = ["ClipBins"]


class ClipBins(nn.Module):
    """Bins into which each clip of a library is cut, from its first frame to the last that an episode may start at.

    Memory grows with the number of clips alone, and the time of a lookup with its logarithm.

    Args:
        library: motions.
        frames_left: an episode has at least this many frames of its clip to come.
        frames_per_bin: length of a bin; the last of a clip may be shorter.
        whole_clips: let episodes start at the first frame of clips that are too short for ``frames_left``.

    >>> from plat.motions import generate_motions
    >>> bins = ClipBins(MotionLibrary.from_clips(generate_motions("train", seconds=8)), frames_left=1)
    >>> bins.start(bins.of_frame(torch.tensor([0, 120]))).tolist()
    [0, 100]
    """

    _clip_start: Tensor
    _clip_last: Tensor
    _usable: Tensor
    _frames_before: Tensor
    _bins: Tensor
    _bins_before: Tensor

    def __init__(
        self, library: MotionLibrary, frames_left: int, frames_per_bin: int = 50, *, whole_clips: bool = False
    ):
        super().__init__()
        self.frames_per_bin = frames_per_bin
        usable = (library.clip_length - frames_left).clamp_min(1 if whole_clips else 0)
        bins = (usable + frames_per_bin - 1) // frames_per_bin
        self.count = int(bins.sum())
        """Number of bins P."""
        self.num_frames = int(usable.sum())
        """Number of frames that an episode may start at."""
        for name, value in (
            ("_clip_start", library.clip_start),
            ("_clip_last", library.clip_start + library.clip_length - 1),
            ("_usable", usable),
            ("_frames_before", usable.cumsum(0) - usable),
            ("_bins", bins),
            ("_bins_before", bins.cumsum(0) - bins),
        ):
            self.register_buffer(name, value, persistent=False)

    def clip_of_bin(self, place: Tensor) -> Tensor:
        """Return the clips of bins ``[*B]``."""
        return _row_of(self._bins_before, place)

    def start(self, place: Tensor) -> Tensor:
        """Return the first frames of bins ``[*B]``."""
        clip = self.clip_of_bin(place)
        return self._clip_start[clip] + (place - self._bins_before[clip]) * self.frames_per_bin

    def size(self, place: Tensor) -> Tensor:
        """Return the numbers of frames of bins ``[*B]``."""
        clip = self.clip_of_bin(place)
        begin = (place - self._bins_before[clip]) * self.frames_per_bin
        return (self._usable[clip] - begin).clamp_max(self.frames_per_bin)

    def of_frame(self, frame: Tensor, back: int = 0) -> Tensor:
        """Return the bins of frames ``[*B]``, or those so many before in the clip.

        Frames behind the last that an episode may start at belong to the last bin of their clip.
        """
        clip = _row_of(self._clip_start, frame)
        number = ((frame - self._clip_start[clip]) // self.frames_per_bin).minimum(self._bins[clip] - 1)
        return self._bins_before[clip] + (number - back).clamp_min(0)

    def last_of(self, frame: Tensor) -> Tensor:
        """Return the last frames of the clips of frames ``[*B]``."""
        return self._clip_last[_row_of(self._clip_start, frame)]

    def draw_frames(self, count: int) -> Tensor:
        """Draw frames ``[count]`` uniformly of those that an episode may start at."""
        number = torch.randint(self.num_frames, (count,), device=self._usable.device)
        clip = _row_of(self._frames_before, number)
        return self._clip_start[clip] + number - self._frames_before[clip]

    def draw_within(self, place: Tensor) -> Tensor:
        """Draw a frame of each of the bins ``[n]``."""
        size = self.size(place)
        within = (torch.rand(len(place), device=place.device) * size).long()
        return self.start(place) + within.minimum(size - 1)


def _row_of(before: Tensor, number: Tensor) -> Tensor:
    """Return the rows that numbers are in, where ``before`` says how many numbers come before each row.

    Of rows that begin alike all but the last are empty.
    """
    return torch.searchsorted(before, number.contiguous(), right=True) - 1
