import pytest

from plat.motions.formats.comment_rate import rates_in_comment, rates_in_comments, without_steps


@pytest.mark.parametrize(
    ("comment", "rates"),
    [
        ("25 frames per second", [25]),
        ("Frame rate (Hz): 50", [50]),
        ("sampling rate [Hz]: 50", [50]),
        ("dt (s): 0.02", [50]),
        ("dt (s) 0.02", [50]),
        ("dt = 20 ms", [50]),
        ("20 ms per frame", [50]),
        ("20 ms/frame", [50]),
        ("one row every 20 ms", [50]),
        ("fs=50", [50]),
        ("fs: 50 Hz", [50]),
        ("Bandai-Namco 30 fps", [30]),
        ("Butterworth 4th order (6 Hz), 120 fps", [120]),
        ("120 fps (Butterworth, 6 Hz)", [120]),
        ("sampling rate: 100", [100]),
        ("framerate=50", [50]),
        ("fps: 50", [50]),
        ("fps50", [50]),
        ("FPS 29.97", [29.97]),
        ("rate: 50", [50]),
        ("rate 50 Hz", [50]),
        ("recorded at 50 Hz", [50]),
        ("50Hz", [50]),
        ("Hz: 50", [50]),
        ("frequency = 50.0", [50]),
        ("sample frequency: 100 Hz", [100]),
        ("frames/s: 60", [60]),
        ("60 frames/s", [60]),
        ("60 frames/sec", [60]),
        ("sampled at 1 kHz", [1000]),
        ("sampling rate: 1 kHz", [1000]),
        ('"fps": 50', [50]),
        ("{'fps': 50.0}", [50]),
        ("timestep: 0.02", [50]),
        ("time step [s] = 0.02", [50]),
        ("frame_time: 0.0333333", [30]),
        ("Frame Time: 16.667 ms", [59.999]),
        ("dt = 1/50 s", [50]),
        ("dt=0.02s", [50]),
        ("dt 0.02", [50]),
        ("period: 0.02 s", [50]),
        ("motion rate: 50", [50]),
        ("frame rate is 50", [50]),
        ("Frame rate in Hz: 50", [50]),
        ("the frame rate of 50 Hz", [50]),
        ("control frequency: 50 Hz", [50]),
        ("physics at 200 Hz and control at 50 Hz", [50]),
        ("IMU 200 Hz, mocap 120 Hz", [120]),
        ("bow at 1 Hz, 30 fps", [30]),
        ("sampled at 50 samples per second", [50]),
        ("fps (1/s): 50", [50]),
        ("frame rate 50 [Hz]", [50]),
        ("frame rate 50 (Hz)", [50]),
        ("60 Hz, lowpass", [60]),
        ("smoothed 30 fps", [30]),
        ("from 120 fps to 30 fps", [120, 30]),
        ("Abtastrate 50 Hz", [50]),
        ("walk_60fps.csv", [60]),
        ("frame rate: 50.", [50]),
        ("fps=50, columns: x y z", [50]),
        ("delta_t: 0.0333 s", [30.03]),
        ("30 frames a second", [30]),
        ("framerate 60 frames per second", [60]),
        ("sampling rate = 100.0 (Hz)", [100]),
        ("Rate 50", [50]),
        ("dt:0.02 unit:s", [50]),
        ("sample_rate_hz: 50", [50]),
        ("fps_hz=50", [50]),
        ("frame_rate_fps=50", [50]),
        ("control_dt: 0.02", [50]),
        ("recorded every 20ms", [50]),
        ("Frame interval (ms): 20", [50]),
        ("f = 50 Hz", [50]),
        ("frames per second: 25", [25]),
        ("Frames per sec = 25", [25]),
        ("update rate 50 Hz", [50]),
        ("frame rate 30, playback rate 1", [30]),
        ("the robot waves at 12 Hz", [12]),
    ],
)
def test_rates_that_a_comment_states(comment, rates):
    assert rates_in_comment(comment) == rates


@pytest.mark.parametrize(
    "comment",
    [
        "playback rate: 1.0",
        "timestep: 0.002, decimation: 10",
        "success rate 98.5 %",
        "gait frequency: 2 Hz",
        "lowpass 6 Hz",
        "low-pass filtered, cutoff frequency 6 Hz",
        "accurate 3",
        "frames: 120",
        "120 frames",
        "physics dt 0.002",
        "sim_dt=0.005",
        "dt=20",
        "learning rate 0.001",
        "yaw rate 10 deg/s",
        "turn rate: 30",
        "rate: 1.0",
        "swing at 2 Hz",
        "joint limits in rad; 29 dof; 36 columns",
        "exported 2024-01-05 12:30:50",
        "fps assumed",
        "mean step frequency 1.8 Hz",
        "delay 20 ms",
        "offs 50",
        "average success rate: 50",
    ],
)
def test_numbers_that_are_no_rates_of_frames(comment):
    assert rates_in_comment(comment) == []


@pytest.mark.parametrize(
    ("comments", "rates"),
    [
        (["downsampled from 120 Hz to 30 Hz"], [30]),
        (["original frame rate: 120, resampled to 50 Hz"], [50]),
        (["fps: 50", "source: amass_120fps"], [50]),
        (["source fps: 120"], [120]),
        (["from 120 fps"], [120]),
    ],
)
def test_rates_of_the_source_count_where_no_other_is_stated(comments, rates):
    assert rates_in_comments(comments) == rates


def test_the_rest_of_the_name():
    assert without_steps("walk_dt0.02") == without_steps("walk_dt20ms") == "walk"
    assert without_steps("walk_dt2") == "walk_dt2"
