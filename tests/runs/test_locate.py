import pytest

from plat.cli import main
from plat.errors import CheckpointError
from plat.runs import SavedRun, load_policy, run_folder, shipped_runs


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """The user's folder is no clone of plat."""
    monkeypatch.chdir(tmp_path)


def test_a_name_stands_for_the_weights_that_come_with_plat():
    assert run_folder("plat-g1") == shipped_runs()["plat-g1"]
    assert SavedRun("dagger-g1").kind == "latent"
    assert load_policy("plat-g1").deployed().out_keys == ["action"]


def test_a_folder_of_that_name_comes_first(tmp_path):
    (tmp_path / "plat-g1").mkdir()
    with pytest.raises(CheckpointError, match=r"plat-g1/config\.json"):
        SavedRun("plat-g1")


def test_what_is_neither_is_answered_with_the_names():
    with pytest.raises(
        CheckpointError, match="'plat-g2': no such run directory; .*dagger-g1, expert-g1, .*imagined-g1, .*plat-g1"
    ):
        SavedRun("plat-g2")


def test_commands_take_names(tmp_path, capsys):
    keyframes = tmp_path / "bow.json"
    main(["keyframes", "from-motion", "generated:val/bow@1", "--times", "0.4", "0.8", "--out", str(keyframes)])
    main(["play", "--policy", "plat-g1", "--keyframes", str(keyframes)])
    main(["evaluate", "plat-g1", "--motions", "generated:val/bow@1", "--horizon", "long", "--device", "cpu"])
    out = capsys.readouterr().out
    assert "2 of 2 reached" in out
    assert "\nplat-g1 " in out
