import pytest
import torch

from plat.envs.transforms import HORIZONS, PAPER_HORIZONS, CommandSchedule, Horizon, RandomizationRanges
from plat.errors import ConfigError, MotionError, TaskError
from plat.evaluation import CommandRecords, evaluate, report
from plat.evaluation.score_table import METRICS
from plat.evaluation.scoring import robots_for, schedule_of_clips
from plat.modules import Expert, PlainPolicy, PlainPolicyConfig
from plat.motions import MotionLibrary
from plat.robots import G1
from tests.conftest import standing_clip
from tests.evaluation.puppet import evaluate_puppet, nowhere, still


@pytest.fixture(scope="module")
def two_clips() -> MotionLibrary:
    """100 and 60 control steps."""
    return MotionLibrary.from_clips([standing_clip("a", frames=61), standing_clip("b", frames=37)])


@pytest.mark.parametrize("horizon", PAPER_HORIZONS.values(), ids=PAPER_HORIZONS)
def test_a_perfect_robot_scores_perfectly(monkeypatch, two_clips, horizon):
    records = evaluate_puppet(monkeypatch, two_clips, horizon, nowhere)
    assert not records.failed.any()
    assert torch.equal(records.steps, records.length.double())
    assert torch.equal(records.window_steps, records.length.clamp_max(3).double())
    figures = report(records)
    assert figures["tks"].value == 100
    assert figures["success_area"].value == pytest.approx(100, abs=1e-3)
    for name in ("mpjpe", "mpkpe", "mpkpe_root", "mpjpe_all", "mpkpe_all", "fall_rate"):
        assert figures[name].value == pytest.approx(0, abs=1e-5)


def test_constant_offsets_are_measured(monkeypatch, two_clips):
    def offset(frame):
        out = nowhere(frame)
        out[:, 0], out[:, 1] = 0.03, 0.04
        out[:, 7] = 0.29
        return out

    figures = report(evaluate_puppet(monkeypatch, two_clips, HORIZONS["mixed"], offset))
    assert figures["mpjpe"].value == pytest.approx(0.01, rel=1e-3)
    # a hip turned by 0.29 rad moves its leg as well, so the world error exceeds the 5 cm of the displacement
    assert 0.05 < figures["mpkpe"].value < 0.10
    assert figures["tks"].value == 100


def test_displacement_alone(monkeypatch, two_clips):
    def offset(frame):
        out = nowhere(frame)
        out[:, 0] = 0.2
        return out

    records = evaluate_puppet(monkeypatch, two_clips, HORIZONS["mixed"], offset)
    figures = report(records)
    assert figures["mpkpe"].value == pytest.approx(0.2, rel=1e-4)
    assert figures["mpkpe_root"].value == pytest.approx(0, abs=1e-5)
    assert figures["success_area"].value == pytest.approx(60, rel=1e-3)  # in 0..0.5 m, from 0.2 m on
    torch.testing.assert_close(records.arrival_error, torch.full_like(records.arrival_error, 0.2), atol=1e-5, rtol=0)


def test_a_fall_fails_one_command_and_the_next_begins_on_the_reference(monkeypatch, two_clips):
    horizon = Horizon(20, 20)  # five commands in the first clip, three in the second

    def offset(frame):
        out = nowhere(frame)
        out[:, 2] = torch.where(frame == 47, -0.4, 0.0)  # in the third command of the first clip, before its window
        return out

    records = evaluate_puppet(monkeypatch, two_clips, horizon, offset)
    assert records.failed.tolist() == [False, False, True, False, False, False, False, False]
    assert records.fell.tolist() == records.failed.tolist()
    assert records.steps.tolist() == [20, 20, 7, 20, 20, 20, 20, 20]
    assert records.window_steps[2] == 0
    figures = report(records)
    assert figures["tks"].value == pytest.approx(100 * 7 / 8)
    assert figures["mpjpe"].value == pytest.approx(0, abs=1e-5)  # over commands that reached their window
    assert figures["mpjpe_all"].value == pytest.approx(0.5 / 8)  # the failed one counts in full
    assert figures["mpkpe_all"].value == pytest.approx(1.0 / 8)
    assert figures["success_area"].value == pytest.approx(100 * 7 / 8)


def test_window_thresholds_fail_a_command_that_has_not_fallen(monkeypatch, two_clips):
    wrist = 7 + G1.joint_names.index("left_shoulder_roll")

    def offset(frame):
        out = nowhere(frame)
        out[:, wrist] = torch.where(frame == 19, 1.8, 0.0)  # an arm up, one step before the first arrival
        return out

    records = evaluate_puppet(monkeypatch, two_clips, Horizon(20, 20), offset)
    assert records.failed.tolist() == [True] + [False] * 7
    assert not records.fell.any()
    assert records.window_steps[0] == 2
    assert records.window["joint_error"][0] == pytest.approx(1.8 / 29 / 2, rel=1e-3)


def test_the_same_offset_outside_the_window_is_free(monkeypatch, two_clips):
    wrist = 7 + G1.joint_names.index("left_shoulder_roll")

    def offset(frame):
        out = nowhere(frame)
        out[:, wrist] = torch.where(frame == 10, 1.8, 0.0)
        return out

    records = evaluate_puppet(monkeypatch, two_clips, Horizon(20, 20), offset)
    assert not records.failed.any()
    assert records.window["joint_error"].max() < 1e-5


@pytest.mark.parametrize("steps", [1, 2])
def test_commands_shorter_than_the_window(monkeypatch, two_clips, steps):
    def offset(frame):
        out = nowhere(frame)
        out[:, 7] = torch.where(frame % 2 == 0, 0.29, 0.0)
        return out

    records = evaluate_puppet(monkeypatch, two_clips, Horizon(steps, steps), offset)
    assert (records.window_steps == steps).all()
    assert report(records)["mpjpe"].value == pytest.approx(0.005, rel=0.02)


def test_a_command_that_the_clips_end_cuts_short(monkeypatch):
    library = MotionLibrary.from_clips([standing_clip(frames=61)])  # 100 steps: 40, 40 and the 20 that are left
    records = evaluate_puppet(monkeypatch, library, Horizon(20, 40), nowhere, seed=3)
    assert int(records.length.sum()) == 100
    assert records.length[-1] >= 20
    records = evaluate_puppet(monkeypatch, library, Horizon(40, 40), nowhere)
    assert records.length.tolist() == [40, 40]  # 20 steps are too few for a command of 40


def test_a_fall_in_a_clips_last_command(monkeypatch, two_clips):
    def offset(frame):
        out = nowhere(frame)
        out[:, 2] = torch.where(frame == 95, -0.4, 0.0)
        return out

    records = evaluate_puppet(monkeypatch, two_clips, Horizon(20, 20), offset, num_envs=1)
    assert records.failed.tolist() == [False] * 4 + [True] + [False] * 3
    assert records.steps.tolist() == [20, 20, 20, 20, 15, 20, 20, 20]


def test_commands_do_not_depend_on_the_policy(library):
    clips = library.only(0, 1, 2)
    first = evaluate(Expert(G1).deployed(), clips, HORIZONS["mixed"], seed=5)
    second = evaluate(still, clips, HORIZONS["mixed"], seed=5)
    assert torch.equal(first.length, second.length)
    assert torch.equal(first.clip, second.clip)
    assert not torch.equal(first.steps, second.steps)


def test_figures_do_not_depend_on_how_many_robots_there_are(library):
    policy, clips = Expert(G1).deployed(), library.pieces(2.0).only(0, 1, 2, 3)
    few, many = (evaluate(policy, clips, HORIZONS["medium"], num_envs=count) for count in (2, 4))
    assert torch.equal(few.steps, many.steps)
    torch.testing.assert_close(few.window["joint_error"], many.window["joint_error"], equal_nan=True)


@pytest.mark.parametrize(
    ("steps", "most", "expected"),
    [
        ([250] * 64, 256, 64),  # clips of one length: nobody waits
        ([1800] + [100] * 36, 256, 3),  # while one follows the long clip, two follow the others
        ([1800] + [100] * 36, 2, 2),
        ([50], 256, 1),
    ],
)
def test_no_robots_that_only_wait(steps, most, expected):
    assert robots_for(steps, most) == expected


def test_evaluating_draws_no_random_numbers(library):
    torch.manual_seed(0)
    expected = torch.rand(1)
    torch.manual_seed(0)
    evaluate(still, library, HORIZONS["long"])
    assert torch.rand(1) == expected


def test_randomization_is_drawn_from_the_seed(two_clips):
    pushed = RandomizationRanges(push_interval=(0.1, 0.2))

    def errors(**settings):
        records = evaluate(still, two_clips, Horizon(10, 10), **settings)
        assert len(records.length) == 16  # the same commands
        return records.window["keypoint_error"].nan_to_num(1.0)

    standing, first, again = (errors(randomization=ranges) for ranges in (None, pushed, pushed))
    assert torch.equal(first, again)
    assert not torch.equal(first, errors(randomization=pushed, seed=1))
    assert first.mean() > 1.5 * standing.mean()


def test_dense_reference_instead_of_the_keyframe(library):
    clip, ahead = library.only(0), list[int]()

    def policy(tensordict):
        frame = tensordict["motion", "frame"]
        for steps in (1, int(tensordict["command", "steps_left"][0])):
            wanted = clip.poses((frame + steps).minimum(clip.last_frame[frame]))["joint_pos"]
            if torch.equal(tensordict["goal", "joint_pos"][0], wanted[0]):
                ahead.append(steps)
                break
        return still(tensordict)

    evaluate(policy, clip, HORIZONS["long"], dense=True, num_envs=1)
    assert set(ahead) == {1}
    ahead.clear()
    evaluate(policy, clip, HORIZONS["long"], num_envs=1)
    assert max(ahead) > 25


def test_every_command_is_evaluated_once(library):
    records = evaluate(still, library, HORIZONS["short"], num_envs=3)
    schedule = CommandSchedule(library, HORIZONS["short"], seed=0)
    assert len(records.steps) == schedule.num_commands
    assert (records.steps >= 1).all()
    assert (records.steps <= records.length).all()
    assert (records.steps == records.length)[~records.failed].all()


def test_a_motion_too_short_for_the_horizon_is_named(two_clips):
    short = MotionLibrary.from_clips([standing_clip("blink", frames=13)])
    with pytest.raises(MotionError, match="'blink'"):
        evaluate(still, short, HORIZONS["long"])


def test_parts_are_pieces_of_the_whole(library):
    policy, pieces = Expert(G1).deployed(), library.pieces(2.0).only(*range(6))
    whole = evaluate(policy, pieces, HORIZONS["long"])
    parts = [evaluate(policy, pieces, HORIZONS["long"], clips=clips) for clips in ([0, 1], [2, 3, 4])]
    joined = CommandRecords.joined(parts)
    assert parts[1].clip.unique().tolist() == [2, 3, 4]
    expected = whole.of_clips(range(5))
    assert torch.equal(joined.length, expected.length)
    assert torch.equal(joined.steps, expected.steps)
    torch.testing.assert_close(joined.window["joint_error"], expected.window["joint_error"], equal_nan=True)


def test_what_is_left_of_a_clip_is_a_command_of_whole_clips():
    library = MotionLibrary.from_clips([standing_clip(frames=61)])  # 100 steps: 40, 40 and 20 that are too few
    _, schedule = schedule_of_clips(library, Horizon(40, 40), 0, [0], whole=True)
    assert schedule.target_frame[schedule.first_frame].tolist() == [40, 80, 100]


def test_of_a_partial_keyframe_the_commanded_part_counts(monkeypatch, two_clips):
    def raised(frame):
        out = nowhere(frame)
        out[:, 7 + G1.joint_names.index("left_elbow")] = 0.8
        return out

    monkeypatch.setattr(still, "in_keys", [("parts", "joints")], raising=False)
    elsewhere = report(evaluate_puppet(monkeypatch, two_clips, HORIZONS["long"], raised, partial="legs"))
    assert elsewhere["mpjpe"].value == pytest.approx(0, abs=1e-5)
    assert elsewhere["mpkpe"].value != elsewhere["mpkpe"].value  # no body was commanded: NaN
    arms = report(evaluate_puppet(monkeypatch, two_clips, HORIZONS["long"], raised, partial="upper_body"))
    assert arms["mpjpe"].value == pytest.approx(0.8 / 17, rel=1e-3)
    hands = report(evaluate_puppet(monkeypatch, two_clips, HORIZONS["long"], raised, partial="hands"))
    assert hands["mpkpe"].value > 0.02


def test_a_root_alone_has_no_error_in_its_own_frame(monkeypatch, two_clips):
    def aside(frame):
        out = nowhere(frame)
        out[:, 0] = 0.1
        out[:, 2] = torch.where(frame == 47, -0.4, 0.0)  # one of eight commands fails
        return out

    monkeypatch.setattr(still, "in_keys", [("parts", "joints")], raising=False)
    records = evaluate_puppet(monkeypatch, two_clips, Horizon(20, 20), aside, partial="root")
    assert records.failed.sum() == 1
    figures = report(records)
    assert figures["mpkpe"].value == pytest.approx(0.1, rel=1e-3)
    for name in ("mpkpe_root", "mpkpe_root_all"):  # was 0, whatever the policy does
        assert METRICS[name].text(figures[name]) == "-"
    hands = report(evaluate_puppet(monkeypatch, two_clips, Horizon(20, 20), aside, partial="hands"))
    assert hands["mpkpe_root"].value == pytest.approx(0, abs=1e-5)


def test_a_policy_for_whole_poses_has_no_score_on_parts(two_clips):
    with pytest.raises(TaskError, match="trained on whole poses"):
        evaluate(Expert(G1).deployed(), two_clips, HORIZONS["long"], partial="hands")


def test_partial_commands_of_a_clip_are_the_same_in_parts(two_clips):
    policy = PlainPolicy(G1, PlainPolicyConfig(also=("parts",))).deployed()
    both = evaluate(policy, two_clips, HORIZONS["medium"], partial="bodies")
    second = evaluate(policy, two_clips, HORIZONS["medium"], partial="bodies", clips=[1])
    torch.testing.assert_close(both.of_clips([1]).arrival_error, second.arrival_error, equal_nan=True)


def test_failures_are_no_errors_of_what_was_not_commanded(monkeypatch, two_clips):
    def falling(frame):
        out = nowhere(frame)
        out[:, 2] = torch.where(frame == 47, -0.4, 0.0)  # one of eight commands
        return out

    monkeypatch.setattr(still, "in_keys", [("parts", "joints")], raising=False)
    legs = evaluate_puppet(monkeypatch, two_clips, Horizon(20, 20), falling, partial="legs")
    assert legs.failed.tolist() == [False] * 2 + [True] + [False] * 5
    assert (legs.commanded["joints"].tolist(), legs.commanded["bodies"].tolist()) == ([True] * 8, [False] * 8)
    figures = report(legs)
    assert figures["mpjpe_all"].value == pytest.approx(0.5 / 8)
    for name in ("mpkpe_all", "mpkpe_root_all", "success_area"):
        assert figures[name].value != figures[name].value, name  # NaN
    hands = report(evaluate_puppet(monkeypatch, two_clips, Horizon(20, 20), falling, partial="hands"))
    assert hands["mpjpe_all"].value != hands["mpjpe_all"].value
    assert hands["mpkpe_all"].value == pytest.approx(1.0 / 8)
    assert hands["success_area"].value == pytest.approx(100 * 7 / 8, abs=0.01)


@pytest.mark.parametrize("seed", [5000, 2**32 - 1])
def test_partial_commands_have_every_seed_that_whole_ones_have(two_clips, seed):
    policy = PlainPolicy(G1, PlainPolicyConfig(also=("parts",))).deployed()
    whole, hands = (evaluate(policy, two_clips, Horizon(20, 40), seed=seed, partial=part) for part in (None, "hands"))
    assert torch.equal(whole.length, hands.length)
    assert not hands.commanded["joints"].any()


def test_an_interface_of_another_name_is_not_a_line(two_clips):
    for dense in (False, True):
        with pytest.raises(ConfigError, match="interface is 'cascde', expected one of next-frame, line, cascade"):
            evaluate(Expert(G1).deployed(), two_clips, Horizon(20, 40), dense=dense, interface="cascde")
