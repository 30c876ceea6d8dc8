import pytest

from plat.errors import KeyframeError
from plat.keyframes import (
    KeyframeSequence,
    long_intervals,
    long_intervals_of_file,
    split_long_intervals,
    standing,
)
from plat.robots import G1
from plat.spec.timing import Timing

POSE = standing(G1)


@pytest.mark.parametrize("seconds", [0.5, 1.0, 1.02, 2.0, 3.7])
def test_it_tells_what_the_split_does(seconds):
    keyframes = [POSE.at(1.0), POSE.at(1.0 + seconds)]
    added = len(split_long_intervals(POSE, keyframes, Timing())) - 2
    assert sum(interval.parts - 1 for interval in long_intervals(POSE, keyframes, Timing())) == added


def test_the_policy_decides_what_is_long(tmp_path):
    slow = Timing(max_steps=150)
    KeyframeSequence(G1, POSE, (POSE.at(2.5),), slow).save(tmp_path / "slow.json")
    assert long_intervals_of_file(tmp_path / "slow.json", G1, slow) == ()
    (interval,) = long_intervals_of_file(tmp_path / "slow.json", G1, Timing())
    assert interval.words.startswith("keyframe 0 comes 2.5 s after the one before, the policy's longest command is 1 s")
    with pytest.raises(KeyframeError, match="no such file"):
        long_intervals_of_file(tmp_path / "none.json", G1, slow)


def test_times_in_another_unit_are_doubted_before_anything_else():
    doubt = "times are in seconds: are these milliseconds or frames?"
    first, second = long_intervals(POSE, [POSE.at(500), POSE.at(1400)], Timing())
    assert first.words.startswith(f"{doubt} keyframe 0 comes 500 s after the one before")
    assert second.words.startswith("keyframe 1 comes 900 s after the one before")
    (slip,) = long_intervals(POSE, [POSE.at(1.0), POSE.at(900.0)], Timing())
    assert slip.words.startswith("keyframe 1 comes 899 s")
