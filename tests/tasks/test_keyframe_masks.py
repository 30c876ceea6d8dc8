import pytest
import torch

from plat.robots import G1
from plat.tasks import TimedKeyframes, TimedKeyframesConfig, draw_chains
from plat.tasks.keyframe_masks import KeyframeMasks


@pytest.fixture(scope="module")
def task(library):
    return TimedKeyframes(library, TimedKeyframesConfig(chains=40, partial=1.0), reset_noise=None)


def test_chains_that_lead_away_command_the_root(task):
    moving = task.chain_rows.moves.nonzero()[:, 0]
    _, memory = task.authored(moving)
    assert (task.masks.table[memory["parts"]][:, -3:] == 1).all()
    # and there are partial ones among them
    assert (memory["parts"] > 0).all()


def test_chains_of_one_kind_are_commanded_by_it(task):
    for name, bodies in (("reach", 2), ("three_point", 3)):
        _, memory = task.authored(torch.tensor([task.chains.family.index(name)] * 5))
        parts = task.masks.table[memory["parts"]]
        assert (parts.sum(-1) == bodies).all()
        assert (parts[:, G1.num_joints : -3].sum(-1) == bodies).all()


@pytest.mark.parametrize("partial", [0.0, 0.3])
def test_as_many_keyframes_are_partial_as_asked_for(library, partial):
    chains = draw_chains(library, 2, ["steps", "arms"])
    masks = KeyframeMasks(G1, chains, partial)
    chain = torch.arange(2).repeat(1000)
    row = masks.draw(chain, torch.arange(2000) < 1000, chains.moves[chain])
    assert float((row > 0).float().mean()) == pytest.approx(partial, abs=0.05)
    assert (masks.table[0] == 1).all()
