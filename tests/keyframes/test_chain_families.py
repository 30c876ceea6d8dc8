import math

import pytest

from plat.control.authored import FAMILIES, author
from plat.envs.part_masks import PART_KINDS
from plat.keyframes.chain_families import FAMILY_TABLE, ChainFamily
from plat.robots import G1
from plat.spec.timing import Timing
from plat.tasks import CHAIN_FAMILIES, TimedKeyframesConfig, draw_chains


def test_both_samplers_know_the_families_of_the_table():
    assert list(FAMILIES) == [name for name, family in FAMILY_TABLE.items() if family.scored]
    assert list(CHAIN_FAMILIES) == [name for name, family in FAMILY_TABLE.items() if family.trained]
    assert TimedKeyframesConfig().families == CHAIN_FAMILIES
    assert all(family.scored or family.trained for family in FAMILY_TABLE.values())


def test_a_family_that_is_trained_commands_what_masks_exist_for():
    commands = {family.commands for family in FAMILY_TABLE.values() if family.trained}
    assert commands <= {"whole", *PART_KINDS}


def test_a_score_needs_times_that_do_not_depend_on_the_policy():
    assert all(math.isfinite(family.interval[1]) for family in FAMILIES.values())


@pytest.fixture
def nod(monkeypatch):
    """A new family, in the table alone."""
    family = ChainFamily("nod", lowered=(0.02, 0.1), lean=0.2, arms=True, hold=1.0)
    for known in (FAMILY_TABLE, FAMILIES):
        monkeypatch.setitem(known, "nod", family)
    monkeypatch.setattr("plat.tasks.chains.CHAIN_FAMILIES", (*CHAIN_FAMILIES, "nod"))


def test_a_new_family_is_a_row(nod, library):
    (chain,) = author("nod", G1, 1, seed=0, timing=Timing())
    heights = [keyframe.qpos[2] for keyframe in chain.sequence.keyframes]
    chains = draw_chains(library, 2, ["nod"])
    assert chain.hold == 1.0
    for height in (*heights, *chains.qpos[chains.steps > 0, 2].tolist()):
        assert 0.02 - 1e-6 <= G1.root_height - height <= 0.1 + 1e-6
    arm = G1.joint_names.index("left_elbow")
    assert len({keyframe.qpos[7 + arm] for keyframe in chain.sequence.keyframes}) == 5
    assert len(chains.qpos[chains.steps > 0, 7 + arm].unique()) == 10
