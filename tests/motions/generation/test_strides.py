import numpy as np
import pytest

from plat.motions.generation.interpolation import minimum_jerk
from plat.motions.generation.script import LEFT, RIGHT, MotionScript
from plat.motions.generation.strides import Course, Strides, take_strides

STANCE = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
RUNNING = Strides(step_time=0.35, flight=0.08, full_speed=2.0, crouch=0.05)


def ahead(time: np.ndarray) -> np.ndarray:
    return 2.0 * (minimum_jerk(time / 1.5) - minimum_jerk((time - 2.2) / 1.5))


def written(course: Course, strides: Strides = RUNNING, count: int = 12) -> MotionScript:
    script = MotionScript(STANCE, {})
    script.wait(0.2)
    take_strides(script, course, strides, count, LEFT)
    script.wait(0.2)
    return script


def test_strides_go_as_far_as_the_course():
    script = written(Course(ahead))
    assert script.feet[:, 0] == pytest.approx(2.0 * 2.2, abs=0.05)
    np.testing.assert_allclose(script.feet[LEFT] - script.feet[RIGHT], STANCE[LEFT] - STANCE[RIGHT], atol=1e-6)


def test_at_speed_both_feet_are_in_the_air_and_the_body_falls_freely():
    draft = written(Course(ahead)).draft(0.01)
    aloft = (draft.foot_pos[..., 2] > 1e-6).all(-1)
    assert 0.03 < aloft.mean() < 0.5
    assert draft.com_rise is not None
    falls = np.diff(draft.com_rise, n=2) / 0.01**2
    inner = aloft[:-2] & aloft[1:-1] & aloft[2:]
    np.testing.assert_allclose(falls[inner], -9.81, atol=0.02)
    assert abs(draft.com_rise[[0, -1]]).max() < 1e-9


def test_walking_never_flies():
    draft = written(Course(lambda time: 0.2 * ahead(time)), Strides(step_time=0.35)).draft(0.01)
    assert not (draft.foot_pos[..., 2] > 1e-6).all(-1).any()


def test_feet_land_ahead_of_a_body_that_brakes():
    draft = written(Course(ahead)).draft(0.01)
    # the zero-moment point is before the middle of the course while it slows down, and behind while it gains speed
    time = draft.time - 0.2 - RUNNING.onset
    course = np.cumsum(ahead(time)) * 0.01
    lead = draft.zmp[:, 0] - course
    gaining, braking = (time > 0.3) & (time < 1.2), (time > 2.5) & (time < 3.4)
    assert lead[gaining].mean() < lead[braking].mean() - 0.1


def test_turning_turns_the_feet():
    script = written(Course(ahead, turning=lambda time: 0.8 * minimum_jerk(time) * (time < 2.0)))
    turned = script.feet[:, 2]
    assert turned[LEFT] == pytest.approx(turned[RIGHT])
    assert 1.0 < turned[LEFT] < 1.4
