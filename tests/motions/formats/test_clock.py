from pathlib import Path

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import MotionClip
from plat.motions.formats.clock import counts_frames, evenly_timed, rate_of_times, rates_of_fields, stated_rates


@pytest.mark.parametrize(("scale", "unit"), [(1, ""), (1, "s"), (1e3, ""), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_times_in_every_unit(scale, unit):
    assert rate_of_times(100 + np.arange(20) * 0.02 * scale, unit) == 50
    assert rate_of_times(np.round(np.arange(20) / 30, 3) * scale, unit) == pytest.approx(30, rel=2e-3)


def test_times_that_waver_a_little():
    times = np.arange(50) / 60 + np.random.default_rng(0).uniform(-2e-3, 2e-3, 50)
    assert rate_of_times(times) == pytest.approx(60, rel=0.01)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, 0.02, 0.04, 0.1, 0.12], "goes on by 0.06 at row 4, by 0.02 elsewhere"),
        ([0.0, 0.02, 0.02, 0.04], "goes on by 0 at row 3"),
        ([1.7e9, 1.7e9, 1.7e9, 1.7e9 + 128], "the time does not go on from row to row"),
        ([0.04, 0.02, 0.0], "the time goes back from row to row"),
        ([0.0, 0.02, np.nan, 0.06], "the time of frame 2 is nan, expected a finite number"),
        ([np.inf, 0.02, 0.04], "the time of frame 0 is inf"),
        ([0.0, -0.02, -0.04], "expected even steps"),
        ([0.0, 3e9, 6e9], "3e.09 a row, a likely rate in no unit"),
    ],
)
def test_times_that_are_no_clock(times, message):
    with pytest.raises(MotionError, match=message):
        rate_of_times(np.array(times))


@pytest.mark.parametrize(
    ("times", "unit", "counts"),
    [
        (np.arange(9), "", True),
        (100.0 + 4 * np.arange(9), "", True),
        (5 * np.arange(9), "", False),
        (np.arange(9), "ms", False),
        (0.5 * np.arange(9), "", False),
        (np.array([0, 1, 2, 4]), "", False),
        (np.zeros(9), "", False),
        (np.zeros(1), "", False),
    ],
)
def test_a_count_of_frames_is_no_clock(times, unit, counts):
    assert counts_frames(times, unit) is counts


def test_all_that_fields_state_is_compared():
    rows = np.zeros((9, 36))
    fields = {"qpos": rows, "fps": np.array([30, 30]), "hz": 30.2, "dt": "0.02", "time": np.arange(9) * 0.1}
    assert rates_of_fields(fields) == [(30.0, "'fps'"), (50.0, "'dt'"), (10.0, "'time'")]
    assert rates_of_fields({"qpos": rows, "t": np.arange(9), "times": np.arange(5) * 0.1}) == []
    with pytest.raises(MotionError, match="expected even steps .or state them: plat motions convert --fps"):
        rates_of_fields({"qpos": rows, "fps": 30, "time": np.array([0, 1, 2, 3, 9, 10, 11, 12, 13]) / 30})


def test_where_rates_are_stated(tmp_path):
    path = tmp_path / "take_60hz.csv"
    assert stated_rates(path, ["exported", "fps: 50"]) == [(50.0, "a comment"), (60.0, "the file name")]
    assert stated_rates(path, ["exported 2024"]) == [(60.0, "the file name")]
    assert stated_rates(tmp_path / "clips_120fps" / "a.csv", []) == [(120.0, "the folder's name")]
    assert stated_rates(tmp_path / "a.csv", []) == []


def test_the_folder_states_its_rate_from_within(tmp_path, monkeypatch):
    (tmp_path / "clips_60fps").mkdir()
    monkeypatch.chdir(tmp_path / "clips_60fps")
    assert stated_rates(Path("a.csv"), []) == [(60.0, "the folder's name")]


@pytest.mark.parametrize("name", ["FPS", "frameRate", "sampling_rate", "mocap_frame_rate", "freq", "fs"])
def test_fields_that_state_the_rate(name):
    assert rates_of_fields({"qpos": np.zeros((9, 36)), name: np.array(50)}) == [(50.0, repr(name))]


def test_a_field_of_many_numbers_is_no_rate_by_a_word_that_means_other_things():
    assert rates_of_fields({"qpos": np.zeros((9, 36)), "rate": np.arange(9.0)}) == []


@pytest.mark.parametrize("name", ["time", "sim_time", "timestamps", "ros_time", "time_since_start"])
def test_fields_that_tell_the_time(name):
    assert rates_of_fields({"qpos": np.zeros((9, 36)), name: np.arange(9) / 50}) == [(50.0, repr(name))]
    assert rates_of_fields({"qpos": np.zeros((9, 36)), "contact_time": np.arange(9) / 50}) == []


def test_a_stated_unit_that_makes_no_likely_rate_gives_way():
    assert rate_of_times(np.arange(9) * 20.0, "s") == rate_of_times(np.arange(9) / 50, "ms") == 50
    with pytest.raises(MotionError, match="a likely rate in no unit"):
        rate_of_times(np.arange(9.0), "s")  # more likely a count


QPOS = np.linspace(np.zeros(36), np.ones(36), 50)
QPOS[:, 3:7] = [1.0, 0, 0, 0]
CLIP = MotionClip("a", QPOS, 50.0)


def test_jitter_leaves_a_clip_as_it_is():
    times = np.arange(50) / 50 + np.random.default_rng(0).uniform(-4e-3, 4e-3, 50)
    assert evenly_timed(CLIP, times) is CLIP
    assert evenly_timed(CLIP, np.arange(50)) is CLIP
    bursts = np.arange(50) / 50 + np.tile([0, 0.015], 25)
    found = evenly_timed(CLIP, bursts)
    assert (found.qpos is CLIP.qpos, found.notes) == (True, ("frames 0.00492 to 0.0345 s apart, read as even",))


def test_frames_of_another_pace_are_made_even():
    times = np.concatenate((np.arange(25) * 0.02, 0.48 + np.arange(1, 26) * 0.035))
    found = evenly_timed(MotionClip("a", QPOS, 49 / times[-1]), times)
    np.testing.assert_allclose(found.qpos[:, 0], np.interp(np.linspace(0, times[-1], 50), times, QPOS[:, 0]))
    assert found.notes == ("frames 0.02 to 0.035 s apart, resampled to even ones",)


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (0, "'dt' is 0, expected a positive time"),
        (-0.02, "'dt' is -0.02, expected a positive time"),
        (20, "'dt' is 20 s a frame, expected 0.001 to 1 .50 frames a second if it is in milliseconds.$"),
        (16667, "'dt' is 16667 s a frame, expected 0.001 to 1 .60 frames a second if it is in microseconds.$"),
        (1e-4, "'dt' is 0.0001 s a frame, expected 0.001 to 1$"),
    ],
)
def test_a_time_that_no_frame_takes(step, message):
    with pytest.raises(MotionError, match=message):
        rates_of_fields({"qpos": np.zeros((9, 36)), "dt": step})


def test_a_time_step_of_physics_is_compared_with_a_stated_rate():
    assert rates_of_fields({"fps": 50, "dt": 2e-4}) == [(50.0, "'fps'"), (5000.0, "'dt'")]
