"""A part of the campaign: what is refused before any work."""

import random

import pytest

from tests.campaigns.command_lines import QUICK, Case, cases, environment_cases, tried

NAMES = dict.fromkeys(
    ("clips", "keyframes", "expert", "latent", "tmp", "text", "folder", "empty", "bvh"), "nothing_of_this_name"
)


def test_the_campaign_is_large_and_says_nothing_twice():
    everything = [*cases(), *environment_cases()]
    assert len(everything) == len(set(everything)) >= 200


@pytest.mark.parametrize("case", random.Random(0).sample(cases(QUICK), 25), ids=lambda case: case.words[-40:])
def test_misused_command_lines_are_one_line(case):
    assert tried(case, NAMES).fault == ""


def test_a_fault_is_found():
    assert tried(Case("motions inspect nothing.npz", right=True), NAMES).fault == "did not come to its end"
    assert tried(Case("--version"), NAMES).fault == "was not refused"
