import time

import pytest
import torch
from tensordict import TensorDict

from plat.collectors import RolloutReplay
from plat.errors import ConfigError, StateError


def rollout(start, robots=4, steps=5, done_at=()):
    """Rollout whose entry says robot and time."""
    when = torch.arange(start, start + steps).expand(robots, -1)
    done = torch.zeros(robots, steps, 1, dtype=torch.bool)
    for robot, step in done_at:
        done[robot, step - start] = True
    entries = {"robot": torch.arange(robots)[:, None].expand(-1, steps), "group": {"time": when}}
    return TensorDict({**entries, "next": {"done": done}, "unused": when}, [robots, steps])


@pytest.fixture
def replay():
    """Five rollouts of five steps in a ring of twenty; robot 2's episode ends with step 12."""
    replay = RolloutReplay(4, 20, ["robot", "group"])
    for start in range(0, 25, 5):
        replay.extend(rollout(start, done_at=[(2, 12)] if start == 10 else []))
    return replay


def test_a_window_is_one_robots_successive_steps(replay):
    windows = replay.windows(200, 6)
    assert windows.shape == (200, 6)
    assert (windows["robot"] == windows["robot"][:, :1]).all()
    assert (windows["group", "time"].diff(dim=1) == 1).all()
    times = windows["group", "time"]
    assert set(times.unique().tolist()) == set(range(5, 25))  # the oldest have given way
    assert "unused" not in set(windows.keys())


def test_a_window_holds_one_episode(replay):
    windows = replay.windows(400, 4)
    torn = (windows["group", "time"][:, 0] <= 12) & (windows["group", "time"][:, -1] > 12)
    assert not (torn & (windows["robot"][:, 0] == 2)).any()
    assert (torn & (windows["robot"][:, 0] == 1)).any()


def test_recent_steps(replay):
    assert set(replay.states(300, recent=4)["group", "time"].tolist()) == {21, 22, 23, 24}
    assert len(replay.states(300)["group", "time"].unique()) == 20
    assert len(replay) == 20


def test_too_few_steps_and_a_capacity_that_does_not_fit():
    replay = RolloutReplay(4, 20, ["robot"])
    replay.extend(rollout(0))
    with pytest.raises(ValueError, match="5 control steps, expected at least a window of 6"):
        replay.windows(3, 6)
    with pytest.raises(ValueError, match="capacity is 21, expected a multiple of the rollouts' 5"):
        RolloutReplay(4, 21, ["robot"]).extend(rollout(0))


def test_episodes_that_are_all_shorter_than_a_window():
    replay = RolloutReplay(2, 20, ["x"])
    done = torch.arange(10).remainder(2).bool().expand(2, 10)[..., None]
    replay.extend(TensorDict({"x": torch.zeros(2, 10), "next": {"done": done}}, [2, 10]))
    assert replay.windows(4, 2).shape == (4, 2)
    with pytest.raises(ConfigError, match="replay: no 3 successive steps of an episode were found, expected episodes"):
        replay.windows(4, 3)


def test_what_a_sample_costs_does_not_grow_with_the_storage():
    def seconds(capacity):
        replay = RolloutReplay(64, capacity, ["group"])
        for start in range(0, capacity, 50):
            replay.extend(rollout(start, robots=64, steps=50))
        best = float("inf")
        for _ in range(20):
            begin = time.process_time()
            replay.windows(64, 8)
            best = min(best, time.process_time() - begin)
        return best

    assert seconds(2000) < 8 * seconds(100)  # of a storage that is 20 times as large


def test_what_is_loaded_is_on_the_device_of_the_replay(replay):
    # "meta" stands for a GPU: a checkpoint is read to the CPU
    resumed = RolloutReplay(4, 20, ["robot", "group"], device="meta")
    resumed.load_state_dict(replay.state_dict())
    rows = resumed.buffer.storage[:]
    assert {value.device.type for value in rows.values(True, True)} == {"meta"}
    assert rows.device.type == "meta"


@pytest.mark.parametrize(
    ("robots", "capacity", "keys", "message"),
    [
        (3, 20, ["robot", "group"], "replay: a state of 4 robots, expected 3"),
        (4, 40, ["robot", "group"], "buffer: a state of 80 rows, expected 160, as many as it has"),
        (4, 20, ["robot"], "replay: a state of group, robot, expected robot"),
    ],
)
def test_a_state_of_another_shape_is_refused(replay, robots, capacity, keys, message):
    other = RolloutReplay(robots, capacity, keys)
    with pytest.raises(StateError, match=message):
        other.load_state_dict(replay.state_dict())
    assert len(other) == 0


def test_an_empty_replay_is_loaded_as_it_is():
    resumed = RolloutReplay(4, 20, ["robot"])
    resumed.load_state_dict(RolloutReplay(4, 20, ["robot"]).state_dict())
    resumed.extend(rollout(0))
    assert (len(resumed), len(resumed.states(9))) == (5, 9)


def test_a_replay_goes_on_from_its_state(replay):
    resumed = RolloutReplay(4, 20, ["robot", "group"])
    resumed.load_state_dict(replay.state_dict())
    for each in (replay, resumed):
        each.extend(rollout(25))
    assert resumed.buffer.storage[:]["group", "time"].equal(replay.buffer.storage[:]["group", "time"])
    torch.manual_seed(1)
    wanted = replay.windows(8, 4)["group", "time"]
    torch.manual_seed(1)
    assert resumed.windows(8, 4)["group", "time"].equal(wanted)


@pytest.mark.parametrize(
    ("what", "arguments", "message"),
    [
        ("windows", (4, 0), "replay: length is 0, expected a whole number of at least 1"),
        ("windows", (0, 4), "replay: batch is 0, expected a whole number of at least 1"),
        ("states", (0,), "replay: batch is 0"),
        ("states", (4, -1), "replay: recent is -1, expected a whole number of at least 1 or None"),
    ],
)
def test_samples_of_nothing_are_refused(replay, what, arguments, message):
    with pytest.raises(ConfigError, match=message):
        getattr(replay, what)(*arguments)


def test_a_replay_without_steps_has_no_samples():
    with pytest.raises(ConfigError, match="replay: 0 control steps, expected at least"):
        RolloutReplay(4, 20, ["robot"]).states(4)


def test_an_entry_alone_is_one():
    replay = RolloutReplay(4, 20, "group")
    replay.extend(rollout(0))
    assert replay.states(3)["group", "time"].shape == (3,)
