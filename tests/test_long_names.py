"""Names that are too long for a file, from a command line or out of a file: there is no such file."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from plat.deploy.onnx_session import open_session
from plat.errors import PlatError
from plat.keyframes import KeyframeSequence
from plat.motions import load_motions
from plat.robots import G1, get_robot
from plat.runs import is_run, load_policy
from plat.runs.outputs import check_out

READERS: dict[str, Callable[[str], object]] = {
    "policy": load_policy,
    "motions": lambda name: load_motions(f"{name}.npz"),
    "keyframes": lambda name: KeyframeSequence.load(Path(f"{name}.json"), G1),
    "robot": lambda name: get_robot(f"{name}.json"),
    "asset": lambda name: replace(G1, asset=name).model(),
    "network": lambda name: open_session(Path(f"{name}.onnx")),
    "run to resume": lambda name: check_out(Path(name), resume=True),
}


@pytest.mark.parametrize("name", ["x" * 5000, "x/" * 3000 + "x"], ids=["one part", "many parts"])
@pytest.mark.parametrize("reader", READERS)
def test_it_is_refused(reader, name):
    with pytest.raises(PlatError, match="no such|no run to go on with|cannot be read"):
        READERS[reader](name)


def test_an_asset_with_a_long_name_gives_a_short_message():
    with pytest.raises(PlatError) as error:
        replace(G1, asset="x" * 5000).model()
    assert len(str(error.value)) < 300


def test_there_is_no_run():
    assert not is_run(Path("x" * 5000))
