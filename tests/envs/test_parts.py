import torch

from plat.envs.parts import draw_parts
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
