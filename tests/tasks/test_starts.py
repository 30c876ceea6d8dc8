import pytest
import torch

from plat.envs import MotionTrackingEnv
from plat.envs.transforms import FailureWeightedStarts
from plat.errors import ConfigError
from plat.tasks import DenseTracking, SimulatedTask, TimedKeyframes
from plat.tasks.starts import ClipStarts, FailureWeights


def test_more_starts_in_the_seconds_before_failures(library):
    starts = ClipStarts(library, uniform=0.3)
    frame = int(library.clip_start[2]) + 120
    starts.record(torch.full((2000,), frame))
    drawn = starts.draw(2000)
    near = ((drawn > frame - 100) & (drawn <= frame + 50)).float().mean()
    everywhere = ClipStarts(library).draw(2000)
    assert near > 3 * ((everywhere > frame - 100) & (everywhere <= frame + 50)).float().mean()
    # a share stays uniform
    assert len(library.clip_of_frame[drawn].unique()) == library.num_clips


def test_starts_leave_frames_to_come(library):
    drawn = ClipStarts(library, frames_left=10).draw(3000)
    assert (library.last_frame[drawn] - drawn >= 9).all()


def test_failures_are_forgotten():
    weights = FailureWeights(4, uniform=0.0, memory=10)
    weights.record(torch.zeros(100, dtype=torch.int64))
    for _ in range(200):
        weights.forget()
    assert float(weights.failures.max()) < 0.03


def test_failure_weights_are_part_of_the_state(library):
    task = DenseTracking(library)
    task.starts.record(torch.arange(50))
    other = DenseTracking(library)
    other.load_state_dict(task.state_dict())
    assert other.starts.weights.failures.equal(task.starts.weights.failures)
    # motions are not: they are read again
    assert sum(value.numel() for value in task.state_dict().values()) == len(task.starts.weights.failures)


def test_many_places_are_drawn_as_often_as_their_failures_say():
    weights = FailureWeights(1000, uniform=0.0)
    weights.failures.fill_(0.02)
    weights.forget()
    weights.record(torch.tensor([255, 256, 999]).repeat(25), 0.2)
    counts = torch.bincount(weights.draw(100_000), minlength=1000) / 100_000
    expected = weights.failures / weights.failures.sum()
    torch.testing.assert_close(counts[[255, 256, 999]], expected[[255, 256, 999]], rtol=0.05, atol=0)
    others = torch.ones(1000, dtype=torch.bool)
    others[[255, 256, 999]] = False
    torch.testing.assert_close(counts[others].sum(), expected[others].sum(), rtol=0.05, atol=0)
    assert (counts[others] > 0).float().mean() > 0.95


def test_a_share_of_the_draws_is_uniform():
    weights = FailureWeights(600, uniform=0.5)
    failures = torch.zeros(600)
    failures[7] = 5.0
    weights.load_state_dict({"failures": failures})
    drawn = weights.draw(20_000)
    assert abs(float((drawn == 7).float().mean()) - 0.5) < 0.02
    assert len(drawn.unique()) == 600


def test_many_places_are_forgotten_in_turns(monkeypatch):
    monkeypatch.setattr("plat.tasks.starts._AT_ONCE", 256)
    weights = FailureWeights(700, memory=10)
    weights.record(torch.arange(700), 1.5)
    for _ in range(3):
        weights.forget()
    torch.testing.assert_close(weights.failures, torch.full((700,), 2.0 * 0.9**3))
    torch.testing.assert_close(weights._sums.sum(), weights.failures.sum())
    weights.forget()
    assert len(weights.failures.unique()) == 2
    other = FailureWeights(700, memory=10)
    other.load_state_dict(weights.state_dict())
    for one in (weights, other):
        one.forget()
    assert other.failures.equal(weights.failures)
    torch.testing.assert_close(other._sums, weights._sums)


@pytest.mark.parametrize("count", [5, 70_000])
def test_to_forget_all_is_to_begin_anew(count):
    weights, new = FailureWeights(count), FailureWeights(count)
    weights.record(torch.tensor([3, 4]))
    weights.forget()
    weights.forget_all()
    for name, value in new.named_buffers():
        assert torch.equal(dict(weights.named_buffers())[name], value), name


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda library: FailureWeights(0), "starts: count is 0"),
        (lambda library: FailureWeights(3, uniform=2.0), "starts: uniform is 2.0, expected a number from 0 to 1"),
        (lambda library: FailureWeights(3, memory=0.0), "starts: memory is 0.0, expected a number of at least 1"),
        (lambda library: ClipStarts(library, frames_left=-1), "starts: frames_left is -1"),
        (lambda library: DenseTracking(library, {"goal": -1}), "DenseTracking: goal 'goal': frames ahead is -1"),
        (lambda library: DenseTracking(library, costs=2.0), "DenseTracking: costs is 2.0, expected a TrackingCosts"),
        (lambda library: DenseTracking("x.npz"), "DenseTracking: library is 'x.npz', expected a MotionLibrary"),
        (lambda library: TimedKeyframes("x.npz"), "TimedKeyframes: library is 'x.npz', expected a MotionLibrary"),
        (lambda library: TimedKeyframes(library, seed=-1), "TimedKeyframes: seed is -1"),
        (lambda library: TimedKeyframes(library, timing=0.02), "TimedKeyframes: timing is 0.02, expected a Timing"),
        (lambda library: SimulatedTask(DenseTracking(library), 2, num_threads=0), "environment: num_threads is 0"),
        (lambda library: SimulatedTask(DenseTracking(library), 2, randomization=1), "environment: randomization is 1"),
        (lambda library: FailureWeightedStarts(library, 0), "starts: num_envs is 0"),
        (lambda library: MotionTrackingEnv(library, 2, reset_noise=0.1), "environment: reset_noise is 0.1"),
        (lambda library: MotionTrackingEnv("x.npz", 2), "environment: library is 'x.npz', expected a MotionLibrary"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(library, make, message):
    with pytest.raises(ConfigError, match=message):
        make(library)
