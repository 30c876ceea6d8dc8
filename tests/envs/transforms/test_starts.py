import pytest
import torch

from plat.envs import MotionTrackingEnv, make_tracking_env
from plat.envs.transforms import FailureWeightedStarts
from plat.errors import ConfigError
from plat.motions import MotionLibrary
from tests.conftest import standing_clip


def two_clips() -> MotionLibrary:
    return MotionLibrary.from_clips([standing_clip("short", frames=61), standing_clip("long", frames=301)])


def test_uniform_over_frames_before_any_failure():
    library = two_clips()
    frames = FailureWeightedStarts(library, 1).sample(20000)
    share = (library.clip_of_frame[frames] == 0).float().mean()
    assert abs(share - 100 / 600) < 0.02
    assert (library.last_frame[frames] > frames).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"uniform": 3.0}, "starts: uniform is 3.0, expected a number from 0 to 1"),
        ({"bin_seconds": -1.0}, "starts: bin_seconds is -1.0, expected a number above 0"),
        ({"lead": 0}, "starts: lead is 0, expected a whole number of at least 1"),
        ({"memory": 1}, "starts: memory is 1, expected a whole number of at least 2"),
    ],
)
def test_settings_out_of_bounds_are_named(settings, message):
    with pytest.raises(ConfigError, match=message):
        FailureWeightedStarts(two_clips(), 1, **settings)


def test_every_frame_can_be_drawn():
    library = two_clips()
    drawn = FailureWeightedStarts(library, 1).sample(60000).unique()
    usable = (library.last_frame - torch.arange(len(library)) >= 1).sum()
    assert len(drawn) == usable


def test_failures_draw_starts_to_the_seconds_before_them():
    library = two_clips()
    starts = FailureWeightedStarts(library, 1, uniform=0.2)
    failure = int(library.clip_start[1]) + 260  # in the sixth second of the long clip
    for _ in range(50):
        starts.record(torch.tensor([failure]))
        starts._advance()
    frames = starts.sample(20000)
    second = (frames - library.clip_start[1]) // 50
    near = (second >= 3) & (second <= 5)
    assert near.float().mean() > 0.75
    # the second of the failure itself most, those before it less and less
    counts = [int((second == index).sum()) for index in (5, 4, 3)]
    assert counts == sorted(counts, reverse=True)


def test_a_share_stays_uniform():
    library = two_clips()
    starts = FailureWeightedStarts(library, 1, uniform=0.5)
    starts.record(torch.full((100,), int(library.clip_start[1])))
    for _ in range(50):
        starts._advance()
    share = (library.clip_of_frame[starts.sample(20000)] == 0).float().mean()
    assert abs(share - 0.5 * 100 / 600) < 0.02


def test_old_failures_are_forgotten():
    library = two_clips()
    starts = FailureWeightedStarts(library, 1, memory=100)
    starts.record(torch.tensor([10]))
    for _ in range(50):
        starts._advance()
    early = starts.failures.sum()
    for _ in range(450):
        starts._advance()
    assert starts.failures.sum() < 0.05 * early


def test_weights_survive_a_checkpoint(library):
    env = make_tracking_env(library, 4)
    starts = next(t for t in env.transform if isinstance(t, FailureWeightedStarts))
    starts.record(torch.tensor([3, 40]))
    other = make_tracking_env(library, 4)
    other.load_state_dict(env.state_dict())
    restored = next(t for t in other.transform if isinstance(t, FailureWeightedStarts))
    assert torch.equal(restored.failures, starts.failures)


def test_a_checkpoint_that_is_loaded_after_a_seed_was_set_is_kept(library):
    env = make_tracking_env(library, 2)
    (starts,) = (part for part in env.transform if isinstance(part, FailureWeightedStarts))
    starts.record(torch.tensor([30]))
    other = make_tracking_env(library, 2)
    other.set_seed(0)
    other.load_state_dict(env.state_dict())
    other.reset()
    (kept,) = (part for part in other.transform if isinstance(part, FailureWeightedStarts))
    assert torch.equal(kept.failures, starts.failures)
    other.set_seed(0)
    other.reset()
    assert not kept.failures.any()


def test_episodes_start_where_the_transform_says(library):
    env = make_tracking_env(library, 32)
    starts = next(t for t in env.transform if isinstance(t, FailureWeightedStarts))
    starts.sample = lambda count: torch.full((count,), 17)
    assert (env.reset()["motion", "frame"] == 17).all()
    assert isinstance(env.base_env, MotionTrackingEnv)


def test_the_old_name_of_forget_all_warns():
    starts = FailureWeightedStarts(two_clips(), 1)
    starts.record(torch.tensor([70]))
    with pytest.warns(FutureWarning, match="FailureWeightedStarts.forget is now forget_all; the old name is removed"):
        starts.forget()
    assert not starts.failures.any()
