import torch

from plat.motions import MotionLibrary
from plat.motions.bins import ClipBins
from tests.conftest import standing_clip


def three_clips() -> MotionLibrary:
    return MotionLibrary.from_clips([standing_clip(str(frames), frames, 50.0) for frames in (101, 3, 131)])


def test_bins_cover_each_frame_that_can_be_a_start_once():
    library = three_clips()
    bins = ClipBins(library, frames_left=10)
    place = torch.arange(bins.count)
    covered = torch.cat([torch.arange(a, a + n) for a, n in zip(bins.start(place), bins.size(place), strict=True)])
    left = library.last_frame - torch.arange(len(library))
    assert covered.equal((left >= 10).nonzero()[:, 0])
    assert bins.num_frames == len(covered)
    assert bins.clip_of_bin(place).tolist() == [0, 0, 2, 2, 2]  # the second clip is too short


def test_frames_belong_to_the_bin_that_covers_them():
    library = three_clips()
    bins = ClipBins(library, frames_left=10)
    place = torch.arange(bins.count)
    for within in (bins.start(place), bins.start(place) + bins.size(place) - 1):
        assert bins.of_frame(within).equal(place)
    # behind the last start of a clip, and the bin before one, which stays in the clip
    assert bins.of_frame(library.clip_start[[2]] + 130).tolist() == [4]
    assert bins.of_frame(bins.start(place), back=1).tolist() == [0, 0, 2, 2, 3]


def test_short_clips_start_at_their_first_frame_on_request():
    library = three_clips()
    bins = ClipBins(library, frames_left=10, whole_clips=True)
    assert bins.clip_of_bin(torch.arange(bins.count)).tolist() == [0, 0, 1, 2, 2, 2]
    assert int(bins.size(torch.tensor([2]))) == 1


def test_drawn_frames_are_those_that_can_be_starts():
    library = three_clips()
    bins = ClipBins(library, frames_left=120)
    expected = int(library.clip_start[2]) + torch.arange(11)
    assert bins.draw_frames(1000).unique().equal(expected)
    assert bins.draw_within(torch.zeros(1000, dtype=torch.int64)).unique().equal(expected)


def test_last_frames():
    library = three_clips()
    frame = torch.arange(len(library))
    assert ClipBins(library, 1).last_of(frame).equal(library.last_frame)
    assert library.last_of(frame.view(-1, 5)).equal(library.last_frame.view(-1, 5))
    assert library.clip_of(frame).equal(library.clip_of_frame)
