from dataclasses import replace

import numpy as np
import pytest
import torch

from plat.control import Chase, KeyframeScorer, PolicyController, Simulator
from plat.envs.transforms import Horizon
from plat.evaluation import evaluate
from plat.keyframes import KeyframeSequence, standing
from plat.modules import LatentPolicy
from plat.motions import MotionLibrary, generate_motions
from plat.robots import G1
from tests.control.puppets import Limp, Puppet

POSE = standing(G1)


def scores(controller, sequence, **arguments):
    scorer = KeyframeScorer(G1)
    for step in Chase(controller, sequence, Simulator(G1.model()), **arguments):
        scorer.add(step)
    return scorer.scores()


def test_a_robot_that_stays_where_it_is_reaches_where_it_is():
    far = replace(POSE, root_pos=POSE.root_pos + np.array([0.0, 0.0, 0.5]))
    sequence = KeyframeSequence(G1, POSE, (replace(POSE.at(0.2), name="here"), far.at(0.4)))
    here, there = scores(Puppet(), sequence)
    assert (here.index, here.name, here.time) == (0, "here", 0.2)
    assert here.reached
    assert not here.fell
    assert here.joint_error < 0.05
    assert (there.index, there.name) == (1, None)
    assert not there.reached
    # half a meter up, less what the line between the keyframes lacks of it in the last three steps
    assert there.keypoint_error == pytest.approx(0.45, abs=0.03)


def test_a_fall_before_the_window_counts_though_the_pose_is_right_at_last():
    chase = Chase(Puppet(), KeyframeSequence(G1, POSE, (POSE.at(0.2),)), Simulator(G1.model()))
    scorer = KeyframeScorer(G1)
    for step in chase:
        if step.command.steps_left == 6:
            down = replace(POSE, root_pos=POSE.root_pos - np.array([0, 0, 0.3]))
            step = replace(step, after=replace(step.after, root_pos_w=down.root_pos))
        scorer.add(step)
    (score,) = scorer.scores()
    assert score.fell
    assert not score.reached
    assert score.joint_error < 0.05


def test_a_limp_robot_falls():
    *_, last = scores(Limp(), KeyframeSequence(G1, POSE, (POSE.at(1.0), POSE.at(2.0))))
    assert last.fell
    assert not last.reached


def test_holding_is_no_keyframe_and_one_whose_arrival_has_not_come_has_no_score():
    sequence = KeyframeSequence(G1, POSE, (POSE.at(0.1), POSE.at(0.2)))
    assert len(scores(Puppet(), sequence, hold=0.5)) == 2
    scorer, chase = KeyframeScorer(G1), Chase(Puppet(), sequence, Simulator(G1.model()))
    for _ in range(7):
        scorer.add(next(chase))
    assert [score.index for score in scorer.scores()] == [0]


def test_scores_are_those_of_the_evaluation():
    """Commands of one step: every step is a window, and the reference at its end is the clip's."""
    torch.manual_seed(0)
    policy = LatentPolicy(G1).deployed()
    clip = generate_motions("val", seconds=1, families=("stand",))[0]
    clip = replace(clip, qpos=clip.qpos[: round(0.6 * clip.fps) + 1])
    library = MotionLibrary.from_clips([clip])
    records = evaluate(policy, library, Horizon(1, 1))
    times = [0.02 * frame for frame in range(1, len(library))]
    sequence = KeyframeSequence.from_motion(clip, times, G1)
    chase = Chase(PolicyController(policy, G1), sequence, Simulator(G1.model()))
    # the evaluation begins at the clip's velocity
    first = library.states(torch.tensor([0]))
    chase.simulator.data.qvel[:3] = first["keypoint_lin_vel"][0, 0]
    chase.simulator.data.qvel[3:6] = first["keypoint_ang_vel"][0, 0]
    chase.simulator.data.qvel[6:] = first["joint_vel"][0]
    scorer = KeyframeScorer(G1)
    for step in chase:
        scorer.add(step)
    rows = scorer.scores()
    until = int(records.failed.nonzero()[0]) if records.failed.any() else len(rows)
    assert until >= 20
    np.testing.assert_allclose(
        [row.joint_error for row in rows[:until]], records.window["joint_error"][:until], atol=2e-4
    )
    np.testing.assert_allclose(
        [row.keypoint_error for row in rows[:until]], records.window["keypoint_error"][:until], atol=2e-4
    )
    assert all(row.reached for row in rows[:until])
    if until < len(rows):
        assert not rows[until].reached
