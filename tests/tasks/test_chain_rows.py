import pytest
import torch

from plat.tasks import draw_chains
from plat.tasks.chain_rows import ChainRows

FRAMES = 100


@pytest.fixture(scope="module")
def chains(library):
    return draw_chains(library, 6, ["steps", "far", "reach"], seed=1)


@pytest.fixture(scope="module")
def rows(chains):
    return ChainRows(chains, FRAMES)


def test_rows_come_after_the_frames(chains, rows):
    goal = torch.arange(len(chains.qpos)) + FRAMES
    assert rows.chain(goal).equal(chains.chain)
    assert goal[rows.first_row - FRAMES].equal(rows.first_row)
    assert (rows.chain(torch.arange(FRAMES)) == 0).all()


def test_a_chain_is_followed_to_its_last_keyframe_and_no_further(chains, rows):
    for number in range(6):
        row, seen = rows.first_row[[number]], []
        for _ in range(len(chains.qpos)):
            row, steps = rows.following(row)
            seen.append(int(row))
            assert int(steps) == int(chains.steps[row - FRAMES])
        of_chain = (chains.chain == number).nonzero()[1:, 0] + FRAMES
        assert seen[: len(of_chain)] == of_chain.tolist()
        assert set(seen[len(of_chain) :]) == {int(of_chain[-1])}


def test_families_say_what_is_out_of_reach_and_how_near_is_near(chains, rows):
    for number, family in enumerate(chains.family):
        assert bool(rows.roams[number]) == (family == "far")
        assert float(rows.reached_within[number]) == pytest.approx(0.05 if family == "reach" else 0.2)
