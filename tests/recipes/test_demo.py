"""What the demo asks of its stages."""

from pathlib import Path

import pytest

from plat.recipes import demo


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


def test_a_killed_demo_goes_on(tmp_path, asked):
    for name in ("expert", "dagger"):
        (tmp_path / name).mkdir()
        Path(tmp_path / name / "config.json").write_text('{"format": "plat-run"}')
    demo.main(demo.DemoRecipe(out=tmp_path))
    assert [stage.resume for stage in asked[:3]] == [True, True, False]
    assert asked[3].out.parent == tmp_path, "an evaluation without a folder keeps nothing of what it has measured"
