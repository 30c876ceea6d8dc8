import pytest
import torch

from plat.envs.part_masks import PART_KINDS, draw_parts
from plat.errors import ConfigError, RobotError, TaskError
from plat.robots import G1


def test_masks_are_of_every_kind_and_never_empty():
    masks = draw_parts(G1, 801)
    assert masks[0].all()
    assert masks.any(-1).all()
    assert not masks[1:].all(-1).any()
    hands = torch.zeros(46, dtype=torch.bool)
    hands[[29 + G1.keypoints.index(f"{side}_wrist_yaw_link") for side in ("left", "right")]] = True
    assert (masks == hands).all(-1).sum() > 20
    root_alone = torch.zeros(46, dtype=torch.bool)
    root_alone[-3:] = True
    assert (masks == root_alone).all(-1).sum() > 20
    assert draw_parts(G1, 9, seed=3).equal(draw_parts(G1, 9, seed=3))


def test_kinds_are_chosen_by_name():
    masks = draw_parts(G1, 5, kinds=["upper_body"], root=False)[1:]
    legs = set(G1.leg_joints)
    assert all(mask.nonzero()[:, 0].tolist() == [joint for joint in range(29) if joint not in legs] for mask in masks)
    with pytest.raises(TaskError, match="kind 'wings', expected some of hands"):
        draw_parts(G1, 5, kinds=["wings"])


def test_every_kind_can_be_drawn():
    for kind in PART_KINDS:
        masks = draw_parts(G1, 20, kinds=[kind], root=False)[1:]
        assert masks.any(-1).all(), kind
        assert masks[:, -3:].all() == (kind == "root")


@pytest.mark.parametrize(("name", "value"), [("count", 0), ("seed", -1)])
def test_arguments_that_make_no_sense_are_refused(name, value):
    with pytest.raises(ConfigError, match=f"partial keyframes: {name} is {value}, expected a whole number"):
        draw_parts(G1, **{"count": 3, name: value})
    with pytest.raises(RobotError, match="robot is 'g1', expected a Robot"):
        draw_parts("g1", 3)
