"""A damaged file of any format is read or refused; it never hangs, runs anything or ends the program."""

import random

import pytest

from plat.errors import MotionError
from plat.motions import load_motions
from tests.motions.formats.writers import WRITERS, bowing_clip


@pytest.fixture(params=sorted(WRITERS))
def good(request, tmp_path):
    path = tmp_path / request.param
    WRITERS[request.param](path, bowing_clip(12))
    assert load_motions(path)
    return path


def read_or_refuse(path, content: bytes) -> bool:
    path.write_bytes(content)
    try:
        load_motions(path)
    except MotionError as caught:
        error = str(caught)
    else:
        return True
    assert path.name in error
    return False


def test_cut_short(good):
    content = good.read_bytes()
    rng = random.Random(0)
    lengths = [0, 1, 2, *(rng.randrange(len(content)) for _ in range(15))]
    outcomes = [read_or_refuse(good, content[:length]) for length in lengths]
    # a table that ends with a whole row, or within its last number, cannot be told from a shorter one
    assert not any(outcomes) or good.suffix == ".csv"


def test_flipped_bits(good):
    content = good.read_bytes()
    rng = random.Random(1)
    for _ in range(40):
        damaged = bytearray(content)
        for _ in range(rng.choice((1, 1, 3, 20))):
            # headers are at the start, and the directory of an archive at the end
            damaged[rng.choice((rng.randrange(200), rng.randrange(len(damaged)), -rng.randrange(1, 200)))] ^= (
                1 << rng.randrange(8)
            )
        read_or_refuse(good, bytes(damaged))
