import torch

from plat.tasks import DenseTracking
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
