"""The examples that docs/components.md names run as they stand."""

import runpy
import sys
import tempfile
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
PRINTED = {
    "distill_loop": "",
    "quantized_latent": "loss_kl",
    "registered_policy": "WidePriorPolicy",
    "score_anything": "more than the pose alone",
    "shifted_latent": "",
    "timed_physics": "ms a step",
}


def test_every_example_is_tried() -> None:
    # those that take arguments have test files of their own
    own = {path.stem.removeprefix("test_") for path in Path(__file__).parent.glob("test_*.py")} - {"examples"}
    folders = {path.parent.name for path in EXAMPLES.glob("*/CMakeLists.txt")}
    assert {path.stem for path in EXAMPLES.glob("*.py")} - {"__init__"} | folders == {*PRINTED, *own}


@pytest.mark.parametrize("name", PRINTED)
def test_it_runs(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))  # nothing is left where temporary files belong
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    assert PRINTED[name] in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "given", "said"),
    [
        ("sim_to_sim", (), "usage: .*sim_to_sim.py BUNDLE"),
        ("sim_to_sim", ("nowhere",), "error: bundle 'nowhere': no such folder"),
        ("planner_in_the_loop", (), "usage: .*planner_in_the_loop.py BUNDLE"),
        ("planner_in_the_loop", ("nowhere",), "error: bundle 'nowhere': no such folder"),
        ("unitree_g1", ("bundle",), "usage: .*unitree_g1.py BUNDLE KEYFRAMES"),
        ("unitree_g1", ("nowhere", "wave.json"), "error: bundle 'nowhere': no such folder"),
    ],
)
def test_one_that_is_started_wrongly_ends_in_one_line(
    name: str, given: tuple[str, ...], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent / "stand_in"))
    monkeypatch.setattr(sys, "argv", [name, *given])
    with pytest.raises(SystemExit, match=f"^{said}"):
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
