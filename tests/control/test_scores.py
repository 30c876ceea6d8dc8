import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from plat.control import Chase, KeyframeScorer, PolicyController, ReachLimits, Simulator, mean_errors, tally
from plat.control.scores import FELL, LATE_OR_OFF, REACHED
from plat.envs.transforms import Horizon
from plat.evaluation import evaluate
from plat.keyframes import Keyframe, KeyframeSequence, only, standing
from plat.modules import LatentPolicy
from plat.motions import MotionLibrary, generate_motions
from plat.robots import G1
from plat.spec.parts import Parts
from tests.control.made_up import score
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
    assert score.root_off
    assert not score.success
    assert score.joint_error < 0.05
    assert score.reached  # it was low for a moment, but it did not lie, and it is there in time


def test_the_three_outcomes_and_by_how_much():
    """The robot of each step is put where the test wants it."""
    aside = replace(POSE, root_pos=POSE.root_pos + np.array([0.5, 0.0, 0.0]))
    sequence = KeyframeSequence(G1, POSE, (POSE.at(0.2), replace(aside, name="late").at(0.4), aside.at(0.6)))
    scorer = KeyframeScorer(G1)
    for step in Chase(Puppet(), sequence, Simulator(G1.model()), hold=0.2):
        x = 0.0 if step.time < 0.45 else 0.5
        height = 0.3 if step.time > 0.71 else 0.76
        after = replace(step.after, root_pos_w=np.array([x, 0.0, height]), joint_pos=POSE.joint_pos)
        scorer.add(replace(step, after=replace(after, root_quat_w=POSE.root_quat)))
    reached, late, last = scorer.scores()
    assert (reached.outcome, reached.words) == ("reached", "reached")
    assert (late.outcome, late.late) == ("late or off", 0.06)
    assert late.words == "late or off: 0.06 s late, 0.50 m off"
    assert late.success  # TKS@3 does not ask where the robot stands
    assert last.words == "reached; fell afterwards"
    assert tally([reached, late, last]) == "2 of 3 reached, 1 late or off; fell afterwards"
    hold = scorer.hold()
    assert hold.fell_at == pytest.approx(0.12)
    assert hold.words == "fell afterwards: 0.12 s after the last arrival"


def test_a_foot_that_leaves_its_place_in_a_hold_has_stepped():
    def held(after):
        scorer = KeyframeScorer(G1, ReachLimits(settling=0.1))
        for step in Chase(Puppet(), KeyframeSequence(G1, POSE, (POSE.at(0.1),)), Simulator(G1.model()), hold=0.4):
            there = np.array([after(step.time), 0.0, 0.76])
            state = replace(step.after, root_pos_w=there, root_quat_w=POSE.root_quat, joint_pos=POSE.joint_pos)
            scorer.add(replace(step, after=state))
        return scorer.hold()

    assert not held(lambda time: 0.0).stepped
    assert not held(lambda time: 0.1 if time < 0.19 else 0.0).stepped  # before it has settled
    assert held(lambda time: 0.05 if time < 0.21 else 0.0).stepped  # its place is where it is after 0.1 s of the hold
    stepped = held(lambda time: 0.05 if 0.3 < time < 0.4 else 0.0)
    assert stepped.stepped
    assert stepped.words == "held for 0.4 s, a foot moved by 0.05 m"
    assert stepped.in_pose
    late = held(lambda time: 0.3 if time < 0.21 else 0.0)
    assert (late.stepped, late.in_pose) == (False, False)  # it was still on its way
    assert late.foot_travel == pytest.approx(0.3)
    assert late.words == "not in the pose, no fall in 0.4 s"


def test_a_hold_that_is_over_before_the_feet_are_watched_says_so():
    scorer = KeyframeScorer(G1)
    for step in Chase(Puppet(), KeyframeSequence(G1, POSE, (POSE.at(0.1),)), Simulator(G1.model()), hold=1.0):
        scorer.add(step)
    assert scorer.hold().foot_travel is scorer.hold().in_pose is None
    assert scorer.hold().words == "held for 1.0 s, too short to see a step"


def test_a_limp_robot_falls():
    *_, last = scores(Limp(), KeyframeSequence(G1, POSE, (POSE.at(1.0), POSE.at(2.0))))
    assert last.fell
    assert last.words == "fell"
    assert not last.reached
    assert not last.success


def test_holding_is_no_keyframe_and_one_whose_arrival_has_not_come_has_no_score():
    sequence = KeyframeSequence(G1, POSE, (POSE.at(0.1), POSE.at(0.2)))
    assert len(scores(Puppet(), sequence, hold=0.5)) == 2
    scorer, chase = KeyframeScorer(G1), Chase(Puppet(), sequence, Simulator(G1.model()))
    for _ in range(7):
        scorer.add(next(chase))
    assert [score.index for score in scorer.scores()] == [0]


def chased(sequence, after, hold=0.0):
    """The scorer of a chase that is shoved out of all bounds after some steps."""
    chase, scorer = Chase(Puppet(), sequence, Simulator(G1.model()), hold=hold), KeyframeScorer(G1)
    for number, (step, errors) in enumerate(scorer.follow(chase), 1):
        assert errors == KeyframeScorer(G1).add(step)
        if number == after:
            chase.simulator.push(np.array([1e12, 0.0, 0.0]))
    assert number == after
    assert re.fullmatch(rf"at {0.02 * after:.2f} s: .*the simulation diverged.*; it fell from there on", scorer.ended)
    return scorer


def test_a_chase_that_ends_by_itself_has_nothing_to_tell():
    chase, scorer = (
        Chase(Puppet(), KeyframeSequence(G1, POSE, (POSE.at(0.1),)), Simulator(G1.model())),
        KeyframeScorer(G1),
    )
    assert [step.time for step, _ in scorer.follow(chase)] == pytest.approx([0.02, 0.04, 0.06, 0.08, 0.1])
    assert scorer.ended == ""


@pytest.mark.parametrize("after", [5, 7])
def test_a_robot_whose_simulation_diverges_fell_at_all_keyframes_from_there_on(after):
    sequence = KeyframeSequence(G1, POSE, (POSE.at(0.1), replace(POSE.at(0.2), name="lost"), POSE.at(0.3)))
    scorer = chased(sequence, after)
    here, lost, last = scorer.scores()
    assert (here.words, here.success) == ("reached", True)
    assert (lost.index, lost.name, lost.time, lost.words, lost.success) == (1, "lost", 0.2, "fell", False)
    assert math.isnan(lost.joint_error)
    assert math.isnan(lost.arrival.root)
    assert (last.index, last.words, last.root_off) == (2, "fell", True)
    assert scorer.hold() is None
    assert tally(scorer.scores()) == "1 of 3 reached, 2 fell"
    assert scorer.scores() == scorer.scores()


@pytest.mark.parametrize("held", [0, 3])
def test_a_robot_whose_simulation_diverges_in_the_hold_fell_afterwards(held):
    scorer = chased(KeyframeSequence(G1, POSE, (POSE.at(0.1),)), 5 + held, hold=0.4)
    assert [score.words for score in scorer.scores()] == ["reached; fell afterwards"]
    assert scorer.hold().words == f"fell afterwards: {0.02 * held:.2f} s after the last arrival"
    assert scorer.hold().down


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
    assert all(row.success for row in rows[:until])
    if until < len(rows):
        assert not rows[until].success


def test_errors_of_what_was_not_commanded_are_no_errors():
    nothing = float("nan")
    scores = [score(0, None, 0.5, joint=nothing, keypoint=0.04), score(1, None, 1.0, joint=0.1, keypoint=0.02)]
    joint, keypoint = mean_errors(scores)
    assert (joint, keypoint) == (pytest.approx(0.1), pytest.approx(0.03))
    assert math.isnan(mean_errors(scores[:1])[0])


@pytest.mark.parametrize(
    ("given", "joints", "places"),
    [
        ({"left_hand": (0.3, 0.2, 1.0)}, False, True),
        ({"joints": {"left_elbow": 0.6}}, True, False),
        ({"root": (0.0, 0.0)}, False, False),
        ({"root": (0.0, 0.0), "height": 0.76}, False, True),
    ],
)
def test_a_partial_keyframe_has_the_errors_of_what_it_commands(given, joints, places):
    sequence = KeyframeSequence(G1, standing(G1), (only(G1, 0.1, **given),))
    scorer = KeyframeScorer(G1)
    for step in Chase(Puppet(), sequence, Simulator(G1.model())):
        scorer.add(step)
    (result,) = scorer.scores()
    assert math.isnan(result.joint_error) == (not joints)
    assert math.isnan(result.keypoint_error) == (not places)


LYING = replace(POSE, root_pos=np.array([0.3, 0.0, 0.12]), root_quat=np.array([np.sqrt(0.5), 0, np.sqrt(0.5), 0]))
HANDS = Parts.only(G1, bodies=("left_wrist_yaw_link", "right_wrist_yaw_link"))


def put(sequence, pose_at) -> KeyframeScorer:
    """The scorer of a chase with a hold, the robot of each step put where the test wants it."""
    scorer = KeyframeScorer(G1)
    for step in Chase(Puppet(), sequence, Simulator(G1.model()), hold=0.2):
        pose = pose_at(step.time)
        after = replace(step.after, root_pos_w=pose.root_pos, root_quat_w=pose.root_quat, joint_pos=pose.joint_pos)
        scorer.add(replace(step, after=after))
    return scorer


@pytest.mark.parametrize("drawn", [LYING, POSE])
def test_a_fall_is_a_fall_however_a_partial_keyframe_is_drawn(drawn):
    sequence = KeyframeSequence(G1, POSE, (replace(drawn.at(0.6), commands=HANDS),))
    scorer = put(sequence, lambda time: LYING if time > 0.3 else POSE)
    (score,) = scorer.scores()
    assert (score.words, score.success) == ("fell", False)
    assert scorer.hold().words == "on the floor"


def low(height: float) -> Keyframe:
    return replace(POSE, root_pos=np.array([0.0, 0.0, height]))


@pytest.mark.parametrize("lag", [-0.2, -0.02, 0.0, 0.02, 0.06])
def test_a_robot_that_sits_down_and_gets_up_a_little_early_or_late_has_not_fallen(lag):
    sequence = KeyframeSequence(G1, POSE, (low(0.3).at(1.0), POSE.at(2.0)))
    scorer = put(sequence, lambda time: low(sequence.sample(min(max(time - lag, 0.0), 2.0)).root_pos[2]))
    sat, stood = scorer.scores()
    assert (sat.outcome, stood.outcome) == (REACHED, REACHED)
    assert scorer.hold().fell_at is None


def test_a_robot_that_does_not_get_up_has_not_fallen_before_it_had_to_stand():
    sequence = KeyframeSequence(G1, POSE, (low(0.3).at(1.0), POSE.at(2.0), POSE.at(2.5)))
    scorer = put(sequence, lambda time: low(max(0.76 - 0.46 * time, 0.3)))
    assert [score.outcome for score in scorer.scores()] == [REACHED, LATE_OR_OFF, FELL]


def test_a_root_that_sinks_where_nothing_says_so_is_told():
    """TKS counts it as fallen, and hands that are where they are to be are no other reason."""
    sequence = KeyframeSequence(G1, POSE, (low(0.42).at(1.0), replace(low(0.12), commands=HANDS).at(2.0)))
    scorer = put(sequence, lambda time: low(max(0.76 - 0.34 * time, 0.12)))
    crouched, reached = scorer.scores()
    assert crouched.words == "reached"
    assert (reached.words, reached.success) == ("late or off: the root too low or tilted", False)


@pytest.mark.parametrize("distance", [0.201, 0.2004])
def test_what_is_a_little_beyond_a_limit_does_not_read_as_the_limit(distance):
    sequence = KeyframeSequence(G1, POSE, (POSE.at(0.5),))
    scorer = put(sequence, lambda time: replace(POSE, root_pos=POSE.root_pos + np.array([distance, 0.0, 0.0])))
    (score,) = scorer.scores()
    assert score.words == f"late or off: {distance} m off"


@pytest.mark.parametrize("then", [HANDS, Parts.only(G1, joints=["left_elbow"])])
def test_who_is_commanded_to_lie_and_not_to_get_up_has_not_fallen(then):
    there, after = replace(LYING, name="lie").at(0.4), replace(LYING, commands=then).at(0.8)
    sequence = KeyframeSequence(G1, LYING, (there, after))
    scorer = put(sequence, lambda time: LYING)
    assert [(score.words, score.success) for score in scorer.scores()] == [("reached", True)] * 2
    assert scorer.hold().words.startswith("held for")


def test_a_robot_that_stands_is_not_off_after_a_keyframe_that_was_drawn_low():
    sequence = KeyframeSequence(G1, POSE, (replace(LYING.at(0.4), commands=HANDS), POSE.at(0.8)))
    _, last = put(sequence, lambda time: POSE).scores()
    assert (last.words, last.success) == ("reached", True)


def test_a_scorer_that_begins_in_the_hold_has_no_arrival_to_count_from():
    steps = list(Chase(Puppet(), KeyframeSequence(G1, POSE, (POSE.at(0.1),)), Simulator(G1.model()), hold=0.1))
    scorer = KeyframeScorer(G1)
    for step in steps[-3:]:
        assert step.holding
        scorer.add(step)
    assert scorer.hold() is None
    assert scorer.scores() == []
