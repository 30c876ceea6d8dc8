import subprocess
import sys

import pytest

from plat.envs import ROBOT_KEYS, entry_shapes, goal_keys, observation_size, privileged_keys
from plat.errors import ObservationError
from plat.robots import G1
from plat.spec.observation import (
    OBSERVATION,
    STUDENT_KEYS,
    Entry,
    ObservationTable,
    as_observed,
    is_goal,
    observed,
    observing,
    student_keys,
)

TOY = OBSERVATION.with_entry("goal", Entry("toy", "m", "world", size=2, per_joint=1, per_body=3, scale=0.5))


def test_sizes_follow_the_specification():
    assert observation_size(ROBOT_KEYS, G1) == 29 + 29 + 3 + 3 + 3 + 29
    assert observation_size(goal_keys(), G1) == 29 + 3 + 6 + 42
    assert observation_size(goal_keys("dense_goal"), G1) == observation_size(goal_keys(), G1)


def test_keys_are_the_entries_of_their_group():
    for group, keys in (("robot", ROBOT_KEYS), ("goal", goal_keys()), ("privileged", privileged_keys())):
        assert keys == tuple((group, name) for name in entry_shapes(group, G1))


@pytest.mark.parametrize(
    "group", ["goal", "goal_6", "dense_goal", "dense_goal_12", "led_goal", "led_dense_goal_6", "near_goal"]
)
def test_names_of_goals(group):
    assert is_goal(group)
    assert observation_size([(group, "root_pos_b")], G1) == 3


@pytest.mark.parametrize("group", ["robot", "goals", "goal_", "goal_x", "goal_06", "dense", "privileged_goal", "robt"])
def test_names_that_are_no_goals(group):
    assert not is_goal(group)
    with pytest.raises(ObservationError, match=f"'{group}' is no goal"):
        goal_keys(group)


def test_unknown_groups_and_entries():
    with pytest.raises(ObservationError, match="unknown observation group 'weather', expected one of .*'robot'"):
        entry_shapes("weather", G1)
    with pytest.raises(ObservationError, match="unknown observation group 'robt'"):
        observation_size([("robt", "joint_pos")], G1)
    with pytest.raises(ObservationError, match="unknown entry 'joint_po' of observation group 'goal', expected .*'joi"):
        observation_size([("goal", "joint_po")], G1)


def test_two_entries_of_one_name():
    with pytest.raises(ObservationError, match="'goal': 'joint_pos' is in it twice"):
        OBSERVATION.with_entry("goal", Entry("joint_pos", "rad", "joint", per_joint=1))


def test_only_entries_of_a_goal_are_commanded():
    for group, entries in OBSERVATION.groups.items():
        assert {entry.commanded_by is not None for entry in entries} == {group == "goal"}


def test_another_table_holds_inside_its_context_alone():
    with observing(TOY):
        assert observation_size(student_keys(), G1) == 177 + 2 + 29 + 42
        assert student_keys()[10] == ("goal", "toy")
    assert student_keys() == STUDENT_KEYS
    with pytest.raises(ObservationError, match="toys"), observing(TOY):
        observation_size([("goal", "toys")], G1)
    assert student_keys() == STUDENT_KEYS


def test_quantities_are_ordered_and_scaled():
    table = ObservationTable({"command": (Entry("b", "m", "world", size=1, scale=2.0), Entry("a", "m", "world"))})
    with observing(table):
        assert list(as_observed("command", {"a": 1.0, "b": 2.0}).items()) == [("b", 4.0), ("a", 1.0)]
        functions = {"a": lambda view: view + 1, "b": lambda view: view, "unused": lambda view: view / 0}
        assert list(observed("command", functions, 3.0).items()) == [("b", 6.0), ("a", 4.0)]


def test_an_entry_that_nothing_computes():
    message = "nothing computes 'horizon' of observation group 'command', only \\['tau'\\]"
    with pytest.raises(ObservationError, match=message):
        as_observed("command", {"tau": 0.5})
    with pytest.raises(ObservationError, match=message):
        observed("command", {"tau": lambda view: view}, 0.5)


def test_the_table_needs_no_torch_and_compiles_no_robot():
    program = "import sys, plat.spec.observation; print({'torch', 'tensordict', 'mujoco'} & set(sys.modules))"
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "set()"
