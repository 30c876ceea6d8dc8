import numpy as np
import pytest

from plat.errors import KeyframeError
from plat.robots import G1
from plat.spec.parts import Parts


def test_names_go_there_and_back():
    names = {"joints": ["left_knee"], "bodies": ["torso_link", "left_wrist_yaw_link"], "root": ["height"]}
    parts = Parts.only(G1, **names)
    assert parts.names(G1) == names
    assert Parts.of_values(parts.mask(), 29) == parts
    assert parts.mask().sum() == 4
    assert not parts.whole


def test_joints_may_be_called_as_in_robots_own_files():
    assert Parts.only(G1, joints=["left_knee_joint"]) == Parts.only(G1, joints=["left_knee"])
    with pytest.raises(KeyframeError, match="joints has 'left_tail_joint'"):
        Parts.only(G1, joints=["left_tail_joint"])


def test_all_is_whole():
    assert Parts.all(G1).whole
    np.testing.assert_array_equal(Parts.all(G1).mask(), np.ones(46))


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({}, "nothing is commanded"),
        ({"joints": ["left_tail"]}, "joints has 'left_tail'"),
        ({"bodies": ["head"]}, "bodies has 'head'"),
        ({"root": ["yaw"]}, "expected some of horizontal, height, orientation"),
    ],
)
def test_names_that_do_not_exist(names, message):
    with pytest.raises(KeyframeError, match=message):
        Parts.only(G1, **names)


@pytest.mark.parametrize("flags", [5, "left_knee", ("left_knee",), (1.0, 0.0), None])
def test_what_is_no_flags_is_named(flags):
    with pytest.raises(KeyframeError, match="parts: bodies is .*, expected True or False each; see Parts.only"):
        Parts((True,), flags, (True, True, True))
    with pytest.raises(KeyframeError, match="parts: bodies is 5, expected names"):
        Parts.only(G1, bodies=5)


def test_flags_of_another_robot():
    with pytest.raises(KeyframeError, match="joints has 3 flags, expected 29"):
        Parts((True,) * 3, (True,) * 14, (True, True, True)).check(G1)


def test_flags_are_the_same_however_they_are_given():
    given = [True] * 29, [np.False_] * 14, [True, False, True]
    parts, same = Parts(*given), Parts(*map(tuple, given))
    assert parts == same
    assert len({parts, same}) == 1


def test_names_of_another_robots_flags():
    with pytest.raises(KeyframeError, match="joints has 3 flags, expected 29"):
        Parts((True,) * 3, (True,) * 14, (True, True, True)).names(G1)
