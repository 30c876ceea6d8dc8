import pytest
import torch

from plat.errors import ConfigError, RecordsError
from plat.evaluation import ClipRecords, compare, evaluate_clips, report_clips
from plat.motions import MotionLibrary
from plat.robots import G1
from tests.conftest import standing_clip
from tests.evaluation.puppet import nowhere, puppet, still

WRIST = 7 + G1.joint_names.index("left_shoulder_roll")


@pytest.fixture(scope="module")
def two_clips() -> MotionLibrary:
    """100 and 60 control steps; the longest is followed first, so frames are those of this library."""
    return MotionLibrary.from_clips([standing_clip("a", frames=61), standing_clip("b", frames=37)])


@pytest.fixture
def followed(monkeypatch, two_clips):
    """Evaluate a robot that is on the reference but for an offset."""

    def follow(offset, rule="humantracker", **options) -> ClipRecords:
        monkeypatch.setattr("plat.evaluation.rollout.MotionTrackingEnv", puppet(offset))
        return evaluate_clips(still, two_clips, rule, **options)

    return follow


def at(wanted: int, column: int, value: float):
    """An offset in one column at one frame."""

    def offset(frame):
        out = nowhere(frame)
        out[:, column] = torch.where(frame == wanted, value, 0.0)
        return out

    return offset


def test_a_perfect_robot_follows_every_clip(followed):
    records = followed(nowhere)
    assert records.rule == "humantracker"
    assert records.clip.tolist() == [0, 1]
    assert records.frames.tolist() == records.tracked.tolist() == [100, 60]
    figures = report_clips(records)
    assert figures["clip_success"].value == 100
    for name in ("clip_mpjpe", "clip_mpkpe", "clip_mpkpe_root", "vel_dist", "accel_dist"):
        assert figures[name].value == pytest.approx(0, abs=1e-5)


def test_a_failure_ends_a_clip(followed):
    records = followed(at(80, 2, -0.4))
    assert records.failed.tolist() == [True, False]
    assert records.tracked.tolist() == [79, 60]
    figures = report_clips(records)
    assert figures["clip_success"].value == 50
    assert figures["clip_progress"].value == pytest.approx(100 * 139 / 160)
    assert figures["clip_mpjpe"].value == pytest.approx(0, abs=1e-6)  # the failed frame is not averaged


def test_the_rules_differ_in_what_they_judge(followed):
    arm_up = at(80, WRIST, 1.8)
    assert followed(arm_up, "humantracker").failed.tolist() == [True, False]
    assert followed(arm_up, "supermimic").failed.tolist() == [False, False]

    def turned(frame):
        """Turned about the vertical by 1.2 rad, which only an orientation error sees."""
        out = nowhere(frame)
        out[:, 3], out[:, 6] = -0.3, 0.6
        return out

    assert followed(turned, "humantracker").failed.all()
    assert not followed(turned, "supermimic").failed.any()


def test_velocity_and_acceleration_distances_of_an_alternating_robot(followed):
    def offset(frame):
        out = nowhere(frame)
        out[:, 0] = torch.where(frame % 2 == 0, 0.01, 0.0)
        return out

    figures = report_clips(followed(offset))
    assert figures["clip_mpkpe"].value == pytest.approx(0.005, rel=0.03)
    assert figures["vel_dist"].value == pytest.approx(0.01, rel=1e-2)
    # over every step but each clip's first, which has no step before it
    assert figures["accel_dist"].value == pytest.approx(0.02, rel=5e-3)


def test_batches_do_not_change_the_records(followed):
    one, both = followed(at(80, 2, -0.4), num_envs=1), followed(at(80, 2, -0.4))
    for name, column in one.columns().items():
        torch.testing.assert_close(column, both.columns()[name], msg=name)


def test_the_rule_stands_in_the_file(followed, tmp_path):
    records = followed(nowhere, "supermimic")
    records.save(tmp_path / "clips.safetensors", {"policy": "a"})
    loaded, about = ClipRecords.load(tmp_path / "clips.safetensors")
    assert about == {"policy": "a", "rule": "supermimic"}
    assert loaded.rule == "supermimic"
    assert torch.equal(loaded.tracked, records.tracked)


def test_partial_keyframes_are_refused(two_clips):
    with pytest.raises(ConfigError, match="partial is 'hands': a whole clip is judged by whole poses, expected None"):
        evaluate_clips(still, two_clips, "humantracker", partial="hands")


def test_unknown_rules_and_mixtures_are_refused(followed, two_clips):
    with pytest.raises(RecordsError, match="success rule 'mine': expected one of humantracker, supermimic"):
        evaluate_clips(still, two_clips, "mine")
    with pytest.raises(TypeError, match="rule"):
        evaluate_clips(still, two_clips)
    one, other = followed(nowhere), followed(nowhere, "supermimic")
    with pytest.raises(RecordsError, match="humantracker"):
        ClipRecords.joined([one, other])
    with pytest.raises(RecordsError, match="judged by 'humantracker' and by 'supermimic'"):
        compare([one], [other])


def test_differences_of_two_policies(followed):
    figures = compare([followed(nowhere)], [followed(at(80, 2, -0.4))])
    assert figures["clip_success"].value == 50
