"""What the demo asks of its stages, and what it draws."""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from plat.errors import CheckpointError
from plat.evaluation import Score
from plat.evaluation.report import Estimate
from plat.recipes import demo
from plat.runs import write_json


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list:
    """Settings that the demo gave to its stages and to the evaluation, none of which runs."""
    settings: list = []
    for part in (demo.expert_model, demo.distill, demo.refine_model, demo.evaluate):
        monkeypatch.setattr(part, "main", lambda recipe: settings.append(recipe) or [])
    for name in ("draw", "play_shipped", "print_table"):
        monkeypatch.setattr(demo, name, lambda _: "")
    return settings


def test_a_killed_stage_loses_less_than_a_quarter(tmp_path, asked):
    demo.main(demo.DemoRecipe(out=tmp_path))
    stages = asked[:3]
    assert [stage.out.name for stage in stages] == ["expert", "dagger", "plat"]
    assert all(stage.save_every <= 60 * stage.minutes / 4 for stage in stages)
    assert not any(stage.resume for stage in stages)
    assert stages[1].policy.symmetric


def test_a_killed_demo_goes_on(tmp_path, asked):
    for name in ("expert", "dagger"):
        (tmp_path / name).mkdir()
        Path(tmp_path / name / "config.json").write_text('{"format": "plat-run"}')
    demo.main(demo.DemoRecipe(out=tmp_path))
    assert [stage.resume for stage in asked[:3]] == [True, True, False]
    assert asked[3].out.parent == tmp_path, "an evaluation without a folder keeps nothing of what it has measured"


def stage(folder: Path, seconds: float | None) -> None:
    """A stage with weights, finished after some seconds or not finished."""
    finished = {} if seconds is None else {"finished": {"steps": 1, "seconds": seconds}}
    write_json(folder / "config.json", {"format": "plat-run", **finished})
    (folder / "model.safetensors").write_bytes(b"weights")


def test_a_stage_that_another_has_learned_from_does_not_train_on(tmp_path, asked):
    def start(**minutes):
        demo.main(demo.DemoRecipe(out=tmp_path, **minutes))

    stage(tmp_path / "expert", 330.1)
    start(expert_minutes=10)  # nothing was made from it
    stage(tmp_path / "dagger", None)
    with pytest.raises(
        CheckpointError, match=r"expert would train to 10 minutes, and dagger was made from it after 5\.5: give"
    ):
        start(expert_minutes=10)
    start(distill_minutes=10)
    stage(tmp_path / "dagger", 120.1)
    stage(tmp_path / "plat", 78.1)
    with pytest.raises(CheckpointError, match="dagger would train to 10 minutes, and plat was made from it after 2"):
        start(distill_minutes=10)
    assert len(asked) == 2 * 4, "something ran"
    start(refine_minutes=10)
    start(expert_minutes=1)
    stage(tmp_path / "expert", None)
    with pytest.raises(CheckpointError, match="dagger was made from it as it was: give another --out"):
        start()


@pytest.mark.skipif(os.name != "posix", reason="processes are asked whether they live")
def test_half_a_video_of_a_killed_demo_is_removed(tmp_path, asked):
    for process in (os.getpid(), 2**22 + 1):  # one that draws now, and one that cannot be
        (tmp_path / f".plat.mp4-{process}-abc_12.part.mp4").write_bytes(b"half")
    demo.main(demo.DemoRecipe(out=tmp_path))
    assert [path.name for path in tmp_path.glob(".*")] == [f".plat.mp4-{os.getpid()}-abc_12.part.mp4"]


def test_a_demo_that_was_stopped_while_it_drew_draws_again(tmp_path, monkeypatch):
    picture = np.full((16, 16, 3), 200, np.uint8)
    library = SimpleNamespace(clip_names=[f"{name}_val_000" for name in ("walk", "reach", "squat")], robot=None)
    monkeypatch.setattr(demo.MotionLibrary, "load", lambda _: library)
    monkeypatch.setattr(demo, "load_policy", lambda _: SimpleNamespace(deployed=lambda: None))
    monkeypatch.setattr(demo, "play", lambda *_: None)
    monkeypatch.setattr(demo, "Stage", lambda *_, **__: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(demo, "contact_sheet", lambda *_: picture)

    def stopped(*_):
        yield picture
        raise KeyboardInterrupt

    monkeypatch.setattr(demo, "film_with_progress", stopped)
    with pytest.raises(KeyboardInterrupt):
        demo.draw(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["contact_sheet.png"]
    monkeypatch.setattr(demo, "film_with_progress", lambda *_: iter([picture] * 3))
    assert str(tmp_path / "plat.mp4") in demo.draw(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"contact_sheet.png", "plat.mp4"}


def test_errors_that_no_command_has_are_dashes(capsys):
    figures = {"tks": Estimate(0.0, 0.0, 0.0), "mpjpe": Estimate(*[np.nan] * 3), "mpkpe": Estimate(*[np.nan] * 3)}
    demo.print_table([Score(run, horizon, (), figures) for run in demo.NAMES for horizon in demo.PAPER_HORIZONS])
    table = capsys.readouterr().out
    assert "0.0 / - / -" in table
    assert "nan" not in table
