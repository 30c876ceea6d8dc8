import pytest

from plat.errors import MotionError
from plat.motions.formats.rate import rates_in_name, without_rates


@pytest.mark.parametrize(
    ("name", "rates"),
    [
        ("walk_60hz", [60]),
        ("walk.bvh_60hz", [60]),
        ("walk_60Hz", [60]),
        ("walk 60 Hz", [60]),
        ("walk_fps60", [60]),
        ("walk_60_fps", [60]),
        ("walk_fps120_v2", [120]),
        ("walk@60", [60]),
        ("walk60fps", [60]),
        ("walk-60FPS", [60]),
        ("walk_60.0fps", [60]),
        ("walk_29.97fps_x", [29.97]),
        ("walk_frame_rate=25", [25]),
        ("walk_120fps_to_30fps", [120, 30]),
        ("30fps_walk_120fps", [30, 120]),
        ("60fps_walk_fps60", [60]),
        ("G1_Take_102", []),
        ("walk_60", []),
        ("dance1_subject2", []),
        ("3hzwalk", []),
        ("kick@3", []),
        ("kick@0", []),
        ("user@123", []),
        ("take@2024", []),
        ("walk@59.94", [59.94]),
        ("walk@30.0", [30]),
        ("run_at_5hz_cutoff", []),
        ("walk_50hz_lowpass_6hz", [50]),
        ("walk_120hz_filtered", [120]),
        ("walk.60fps", [60]),
        ("walk.60fps.v2", [60]),
        ("walk.mp4.30fps", [30]),
        ("take3.60fps", [60]),
        ("walk.001.60fps", [60]),
        ("2024.01.05.60hz", [60]),
        ("walk29.97fps", [29.97]),
        ("walk_119.88fps", [119.88]),
        ("walk_7.5fps", [7.5]),
        ("walk_5fps", [5]),
        ("wave_2hz", []),
        ("wave_0.5hz", []),
        ("arm_sine_1hz_50fps", [50]),
        ("hz_3_wave", []),
        ("walk_10hz", [10]),
    ],
)
def test_rates_that_a_name_states(name, rates):
    assert rates_in_name(name) == rates


def test_no_frames_a_second_are_refused():
    with pytest.raises(MotionError, match="its name states 0 frames a second"):
        rates_in_name("walk_0fps")


def test_the_rest_of_the_name():
    assert without_rates("walk_60hz") == "walk"
    assert without_rates("60fps") == "60fps"
    assert without_rates("kick@3") == "kick@3"
    assert without_rates("walk.60fps") == "walk"
    assert without_rates("take3.60fps") == "take3"
    assert without_rates("walk_50hz_lowpass_6hz") == "walk_lowpass_6hz"
    assert without_rates("arm_2hz_50fps") == "arm_2hz"
