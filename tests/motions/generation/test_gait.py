import numpy as np

from plat.motions.generation.gait import Gait, take_steps
from plat.motions.generation.script import LEFT, RIGHT, SOLE_CENTER, MotionScript

STANCE = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
STEPS = [
    (LEFT, np.array([0.2, 0.1, 0.0])),
    (RIGHT, np.array([0.4, -0.1, 0.0])),
    (LEFT, np.array([0.4, 0.1, 0.0])),
]


def walked(gait: Gait):
    script = MotionScript(STANCE, {})
    take_steps(script, STEPS, gait)
    return script, script.draft(0.01)


def test_time_and_places():
    script, _ = walked(Gait(step_time=0.6, double_support=0.25, onset=0.5))
    # the first shift of the weight takes as long as the onset, the other two a quarter of a step
    assert np.isclose(script.now, 0.5 + 0.15 + 0.15 + 3 * 0.45 + 0.5)
    np.testing.assert_allclose(script.feet, [STEPS[2][1], STEPS[1][1]])


def test_weight_is_on_the_standing_foot_while_the_other_swings():
    _, draft = walked(Gait(step_time=0.6))
    for foot in (LEFT, RIGHT):
        swings = draft.foot_pos[:, foot, 2] > 1e-4
        standing = draft.foot_pos[swings, 1 - foot, :2] + [SOLE_CENTER, 0.0]
        np.testing.assert_allclose(draft.zmp[swings], standing, atol=1e-9)
        assert swings.any()
    assert not (draft.foot_pos[..., 2] > 1e-4).all(-1).any()


def test_weight_rolls_forward_under_the_standing_foot():
    _, draft = walked(Gait(step_time=0.6, roll=0.06))
    second = (draft.foot_pos[:, RIGHT, 2] > 0).nonzero()[0]
    relative = draft.zmp[second, 0] - draft.foot_pos[second, LEFT, 0]
    assert relative[0] < SOLE_CENTER - 0.025
    assert relative[-1] > SOLE_CENTER + 0.025


def test_feet_roll_over_heel_and_toe():
    _, draft = walked(Gait(step_time=0.6, heel_off=0.4, toes_up=0.2))
    pitch = draft.channels["right_foot_pitch"]
    assert np.isclose(pitch.max(), 0.4, atol=0.01)
    leaves = (draft.foot_pos[:, RIGHT, 2] > 0).argmax()
    assert pitch[leaves] > 0.2  # the heel is up when the foot leaves the floor
    assert np.isclose(pitch[-1], 0.0)
