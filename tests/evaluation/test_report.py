import math

import pytest
import torch

from plat.errors import RecordsError
from plat.evaluation import CommandRecords, Estimate, Penalties, compare, report, report_clips, success_curve
from plat.evaluation.clip_records import CLIP_ERRORS, ClipRecords
from plat.evaluation.report import share


def records(**changes) -> CommandRecords:
    """Four commands of two clips; the last one failed before its window."""
    base = {
        "clip": torch.tensor([0, 0, 1, 1]),
        "length": torch.tensor([10, 10, 10, 10]),
        "steps": torch.tensor([10.0, 10, 10, 5], dtype=torch.float64),
        "failed": torch.tensor([False, False, False, True]),
        "fell": torch.tensor([False, False, False, True]),
        "window_steps": torch.tensor([3.0, 3, 3, 0], dtype=torch.float64),
        "window": {
            "joint_error": torch.tensor([0.1, 0.2, 0.9, math.nan], dtype=torch.float64),
            "keypoint_error": torch.tensor([0.1, 0.1, 0.4, math.nan], dtype=torch.float64),
            "keypoint_error_root": torch.tensor([0.05, 0.05, 0.05, math.nan], dtype=torch.float64),
        },
        "arrival_error": torch.tensor([0.1, 0.1, 0.4, math.inf], dtype=torch.float64),
        "step": {
            name: torch.full((4,), 7.0, dtype=torch.float64) for name in ("action_change", "joint_jerk", "foot_slip")
        },
    }
    return CommandRecords(**{**base, **changes})


def test_figures_of_a_hand_made_table():
    figures = report(records())
    assert figures["tks"].value == 75
    assert figures["fall_rate"].value == 25
    assert figures["mpjpe"].value == pytest.approx(1.2 / 3)
    assert figures["mpkpe"].value == pytest.approx(0.2)
    assert figures["mpjpe_all"].value == pytest.approx((0.1 + 0.2 + 0.5 + 0.5) / 4)  # capped, and the failed one full
    assert figures["mpkpe_all"].value == pytest.approx((0.1 + 0.1 + 0.4 + 1.0) / 4)
    assert figures["action_change"].value == pytest.approx(28 / 35)
    assert figures["joint_jerk"].value == pytest.approx(28 / 31)  # the first two steps of each clip have none
    assert figures["success_area"].value == pytest.approx(100 * (0.8 + 0.8 + 0.2 + 0) / 4)


@pytest.mark.parametrize(
    ("steps", "failed", "clip", "expected"),
    [
        ([10, 10, 10], [False, True, False], [0, 0, 0], [8, 10, 8]),
        ([1, 1, 1, 1], [False] * 4, [0, 0, 0, 1], [0, 0, 1, 0]),
        ([1, 5, 2], [True, True, False], [0, 0, 0], [0, 3, 0]),
    ],
)
def test_jerk_is_over_steps_with_two_before_them_since_the_reset(steps, failed, clip, expected):
    """Zeros of the steps after each reset made those smooth who fall often."""
    count = len(steps)
    jerk_steps = torch.tensor(expected, dtype=torch.float64)
    made = CommandRecords(
        clip=torch.tensor(clip),
        length=torch.full((count,), 10),
        steps=torch.tensor(steps, dtype=torch.float64),
        failed=torch.tensor(failed),
        fell=torch.tensor(failed),
        window_steps=torch.zeros(count, dtype=torch.float64),
        window=dict.fromkeys(("joint_error", "keypoint_error", "keypoint_error_root"), torch.zeros(count).double()),
        arrival_error=torch.zeros(count).double(),
        step=dict.fromkeys(("action_change", "joint_jerk", "foot_slip"), 3.0 * jerk_steps),
    )
    assert made.jerk_steps.tolist() == expected
    assert report(made)["joint_jerk"].value == pytest.approx(3.0)
    rows = torch.arange(count) > 0  # what is known is not counted anew
    assert made.of_rows(rows).jerk_steps.tolist() == expected[1:]


def test_penalties_can_be_set():
    assert report(records(), Penalties(joint_error=1.0))["mpjpe_all"].value == pytest.approx((0.1 + 0.2 + 0.9 + 1) / 4)


def test_falling_never_looks_precise():
    careful = report(records())
    # the same, but the worst command is failed before its window: its error drops out of the paper's figure only
    failed = torch.tensor([False, False, True, True])
    reckless = report(records(failed=failed, window_steps=torch.tensor([3.0, 3, 0, 0], dtype=torch.float64)))
    assert reckless["mpjpe"].value < careful["mpjpe"].value
    assert reckless["mpjpe_all"].value >= careful["mpjpe_all"].value
    assert reckless["tks"].value < careful["tks"].value


def test_success_curve():
    x, share = success_curve(records(), points=6)
    torch.testing.assert_close(x, torch.tensor([0, 0.1, 0.2, 0.3, 0.4, 0.5], dtype=torch.float64))
    assert share.tolist() == [0, 0.5, 0.5, 0.5, 0.75, 0.75]


def test_intervals_come_from_motions():
    # within a clip everything is alike, between two clips nothing: resampling clips swings between the two
    split = records(failed=torch.tensor([False, False, True, True]))
    tks = report(split)["tks"]
    assert (tks.low, tks.value, tks.high) == (0, 50, 100)
    same = records(failed=torch.tensor([False, True, False, True]))
    tks = report(same)["tks"]
    assert (tks.low, tks.value, tks.high) == (50, 50, 50)


def test_interval_of_a_known_distribution():
    count = 400
    clip = torch.arange(count)
    failed = torch.arange(count) % 4 == 0
    many = CommandRecords(
        clip=clip,
        length=torch.full((count,), 10),
        steps=torch.full((count,), 10.0, dtype=torch.float64),
        failed=failed,
        fell=failed,
        window_steps=torch.full((count,), 3.0, dtype=torch.float64),
        window={
            name: torch.ones(count, dtype=torch.float64)
            for name in ("joint_error", "keypoint_error", "keypoint_error_root")
        },
        arrival_error=torch.ones(count, dtype=torch.float64),
        step={name: torch.ones(count, dtype=torch.float64) for name in ("action_change", "joint_jerk", "foot_slip")},
    )
    tks = report(many)["tks"]
    half_width = 100 * 1.96 * math.sqrt(0.75 * 0.25 / count)
    assert tks.high - tks.value == pytest.approx(half_width, rel=0.15)
    assert tks.value - tks.low == pytest.approx(half_width, rel=0.15)


def test_no_command_reached_its_window():
    nothing = report(records(window_steps=torch.zeros(4, dtype=torch.float64), failed=torch.ones(4, dtype=torch.bool)))
    assert math.isnan(nothing["mpjpe"].value)
    assert nothing["mpjpe_all"].value == 0.5
    assert nothing["tks"].value == 0


def test_format():
    assert f"{report(records())['tks']:.1f}".startswith("75.0 (")


def test_training_seeds_are_averaged_and_drawn():
    # motions agree, seeds do not: one fails a command in each motion and the other none
    never = records(failed=torch.tensor([False, False, False, False]))
    half = records(failed=torch.tensor([False, True, False, True]))
    tks = report([never, half])["tks"]
    assert (tks.low, tks.value, tks.high) == (50, 75, 100)
    assert report([never, never])["tks"] == report(never)["tks"]
    assert report([records()]) == report(records())


def test_a_success_curve_of_several_seeds():
    near = records(arrival_error=torch.full((4,), 0.1, dtype=torch.float64))
    far = records(arrival_error=torch.full((4,), 0.3, dtype=torch.float64))
    assert success_curve([near, far], points=6)[1].tolist() == [0, 0.5, 0.5, 1, 1, 1]


def test_seeds_of_different_commands_are_refused():
    with pytest.raises(ValueError, match="the same commands for every training seed"):
        report([records(), records(clip=torch.tensor([0, 0, 0, 1]))])


def spread(shift: float) -> CommandRecords:
    """Forty motions, one command each, from easy to hard."""
    error = torch.linspace(0.1, 0.9, 40, dtype=torch.float64) + shift
    every, none = torch.ones(40, dtype=torch.float64), torch.zeros(40, dtype=torch.bool)
    return CommandRecords(
        clip=torch.arange(40),
        length=every.long(),
        steps=every,
        failed=none,
        fell=none,
        window_steps=every,
        window=dict.fromkeys(("joint_error", "keypoint_error", "keypoint_error_root"), error),
        arrival_error=error,
        step=dict.fromkeys(("action_change", "joint_jerk", "foot_slip"), every),
    )


def test_a_difference_on_every_motion_shows_although_intervals_overlap():
    ours, theirs = report(spread(0.0))["mpjpe"], report(spread(0.02))["mpjpe"]
    assert ours.high > theirs.low
    difference = compare(spread(0.0), spread(0.02))["mpjpe"]
    assert difference.value == pytest.approx(-0.02)
    assert difference.high < 0


def test_chance_is_no_difference():
    error = spread(0.0).window["joint_error"]
    scattered = error + 0.1 * torch.randn(40, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    theirs = spread(0.0)
    theirs.window = {**theirs.window, "joint_error": scattered}
    difference = compare(spread(0.0), theirs)["mpjpe"]
    assert difference.low < 0 < difference.high


def test_a_lucky_training_seed_is_not_a_difference():
    ours = [spread(-0.3), spread(0.1), spread(0.1)]  # better on average, by one seed of three
    difference = compare(ours, spread(0.0))["mpjpe"]
    assert difference.value == pytest.approx(-0.1 / 3)
    assert difference.low < 0 < difference.high


def test_policies_with_other_commands_cannot_be_compared():
    with pytest.raises(ValueError, match="the same commands for both policies"):
        compare(records(), spread(0.0))


def test_policies_with_other_lengths_of_commands_cannot_be_compared():
    longer = records(length=torch.tensor([10, 10, 10, 11]))
    with pytest.raises(ValueError, match="the same commands for both policies"):
        compare(records(), longer)
    with pytest.raises(ValueError, match="the same commands for every training seed"):
        report([records(), longer])


def whole_clips(**changes) -> ClipRecords:
    """Two clips, of which the second one failed."""
    frames = torch.tensor([20.0, 30.0], dtype=torch.float64)
    base = {"rule": "supermimic", "clip": torch.tensor([0, 1]), "frames": frames, "tracked": frames}
    base |= {"failed": torch.tensor([False, True]), "errors": dict.fromkeys(CLIP_ERRORS, frames)}
    return ClipRecords(**{**base, **changes})


def test_policies_on_other_clips_cannot_be_compared():
    longer = whole_clips(frames=torch.tensor([20.0, 31.0], dtype=torch.float64))
    with pytest.raises(ValueError, match="the same commands for both policies"):
        compare([whole_clips()], [longer])


def test_pieces_of_a_motion_are_drawn_together():
    failed = torch.tensor([False, False, True, True])
    tks = report(records(failed=failed, source=torch.tensor([4, 4, 4, 4])))["tks"]
    assert (tks.low, tks.value, tks.high) == (50, 50, 50)
    tks = report(records(failed=failed, source=torch.tensor([4, 4, 7, 7])))["tks"]
    assert (tks.low, tks.value, tks.high) == (0, 50, 100)
    success = report_clips(whole_clips(source=torch.tensor([4, 4])))["clip_success"]
    assert (success.low, success.value, success.high) == (50, 50, 50)
    assert report_clips(whole_clips())["clip_success"].high == 100


def test_differences_are_over_motions_and_not_over_their_pieces():
    """Ours is better on one motion of four pieces, and worse on another one of 36."""
    ours, theirs = spread(0.0), spread(0.0)
    source = (torch.arange(40) >= 4).long()
    shift = torch.where(source > 0, 0.02, -0.02)
    theirs.window = {name: error + shift for name, error in theirs.window.items()}
    assert compare(ours, theirs)["mpjpe"].high < 0
    ours.source = theirs.source = source
    found = compare(ours, theirs)["mpjpe"]
    assert found.low < 0 < found.high


def test_only_commands_of_joints_have_errors_of_joints_and_so_for_bodies():
    """The first two command joints, the last two bodies; the second and the last failed before their windows."""
    failed = torch.tensor([False, True, False, True])
    nan = math.nan
    partial = records(
        failed=failed,
        window_steps=torch.tensor([3.0, 0, 3, 0], dtype=torch.float64),
        window={
            "joint_error": torch.tensor([0.1, nan, nan, nan], dtype=torch.float64),
            "keypoint_error": torch.tensor([nan, nan, 0.2, nan], dtype=torch.float64),
            "keypoint_error_root": torch.tensor([nan, nan, 0.2, nan], dtype=torch.float64),
        },
        arrival_error=torch.tensor([nan, math.inf, 0.2, math.inf], dtype=torch.float64),
        commanded={
            "joints": torch.tensor([True, True, False, False]),
            "bodies": torch.tensor([False, False, True, True]),
        },
    )
    figures = report(partial)
    assert figures["mpjpe_all"].value == pytest.approx((0.1 + 0.5) / 2)
    assert figures["mpkpe_all"].value == pytest.approx((0.2 + 1.0) / 2)
    assert figures["mpkpe_root_all"].value == pytest.approx((0.2 + 0.5) / 2)
    assert figures["success_area"].value == pytest.approx(100 * (0.6 + 0) / 2)
    assert success_curve(partial, points=6)[1].tolist() == [0, 0, 0.5, 0.5, 0.5, 0.5]


def test_what_never_failed_may_still_fail():
    """All of four commands were met: of others up to 1 - 0.025 ** (1 / 4) = 60.2 % may be missed for all one knows."""
    never = torch.zeros(4, dtype=torch.bool)
    figures = report(records(failed=never, fell=never))
    assert figures["tks"] == Estimate(100.0, pytest.approx(39.76, abs=0.01), 100.0)
    assert figures["fall_rate"] == Estimate(0.0, 0.0, pytest.approx(60.24, abs=0.01))
    assert report(records(failed=~never, fell=~never))["tks"] == figures["fall_rate"]
    assert report(records())["tks"].low == 50  # of two motions, by the bootstrap
    one = report(records(failed=never, clip=torch.zeros(4, dtype=torch.long)))
    assert one["tks"] == Estimate(100.0, 100.0, 100.0)  # of other motions, one says nothing


def test_the_end_of_a_share_is_where_its_outcome_is_improbable():
    for trials in (1, 7, 500):
        high = share(Estimate(0.0, 0.0, 0.0), trials).high / 100
        assert (1 - high) ** trials == pytest.approx(0.025)
        assert share(Estimate(100.0, 100.0, 100.0), trials).low == pytest.approx(100 * (1 - high))
    assert share(Estimate(50.0, 40.0, 60.0), 10) == Estimate(50.0, 40.0, 60.0)
    nothing = share(Estimate(float("nan"), float("nan"), float("nan")), 0)
    assert math.isnan(nothing.value)


def test_records_of_nothing_have_no_report():
    for figures, some in ((report, records()), (report_clips, whole_clips())):
        with pytest.raises(RecordsError, match="records of no commands or clips, expected at least one"):
            figures(some.of_clips([]))
        with pytest.raises(RecordsError, match="no records, expected those of at least one run"):
            figures([])
    with pytest.raises(RecordsError, match="no commands or clips"):
        compare(records().of_clips([]), records().of_clips([]))
    with pytest.raises(RecordsError, match="no records"):
        success_curve([])


def coverage(motions: int, times: int) -> tuple[float, float]:
    """Return how often an interval holds the true error, and how often equal policies differ beyond chance."""
    generator = torch.Generator().manual_seed(0)
    clip, held, differ = torch.arange(motions), 0, 0

    def of(error: torch.Tensor) -> CommandRecords:
        ones = torch.ones(motions, dtype=torch.float64)
        return CommandRecords(
            clip=clip,
            length=torch.full((motions,), 10),
            steps=10 * ones,
            failed=clip < 0,
            fell=clip < 0,
            window_steps=3 * ones,
            window=dict.fromkeys(("joint_error", "keypoint_error", "keypoint_error_root"), error),
            arrival_error=error,
            step=dict.fromkeys(("action_change", "joint_jerk", "foot_slip"), ones),
        )

    for number in range(times):
        # motions differ more than policies do
        motion = 0.1 * (0.4 * torch.randn(motions, generator=generator, dtype=torch.float64)).exp()
        other = motion + 0.01 * torch.randn(motions, generator=generator, dtype=torch.float64)
        found = report(of(motion), resamples=400, seed=number)["mpjpe"]
        held += found.low <= 0.1 * math.exp(0.08) <= found.high
        differ += compare(of(other), of(motion), resamples=400, seed=number)["mpjpe"].beyond_chance
    return held / times, differ / times


@pytest.mark.slow
@pytest.mark.parametrize(("motions", "held", "differ"), [(2, 0.5, 0.5), (4, 0.77, 0.2), (64, 0.94, 0.06)])
def test_intervals_are_as_wide_as_the_documentation_says(motions, held, differ):
    found = coverage(motions, times=400)
    assert found == pytest.approx((held, differ), abs=0.07)
