import pytest

from plat.envs import ROBOT_KEYS, entry_shapes, goal_keys, observation_size, privileged_keys
from plat.robots import G1


def test_sizes_follow_the_specification():
    assert observation_size(ROBOT_KEYS, G1) == 29 + 29 + 3 + 3 + 3 + 29
    assert observation_size(goal_keys(), G1) == 29 + 3 + 6 + 42
    assert observation_size(goal_keys("dense_goal"), G1) == observation_size(goal_keys(), G1)


def test_keys_are_the_entries_of_their_group():
    for group, keys in (("robot", ROBOT_KEYS), ("goal", goal_keys()), ("privileged", privileged_keys())):
        assert keys == tuple((group, name) for name in entry_shapes(group, G1))


def test_unknown_group():
    with pytest.raises(KeyError):
        entry_shapes("weather", G1)
