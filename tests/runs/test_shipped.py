import shutil

import pytest

import plat
from plat.errors import CheckpointError, ConfigError
from plat.modules import Expert, ExpertConfig
from plat.robots import G1
from plat.runs import SavedRun, locate, policy_spec, save_weights, write_json
from plat.runs.shipped import load_shipped, shipped_runs


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """An installation with other weights."""
    policy = Expert(G1, ExpertConfig(hidden=(8,)))
    write_json(tmp_path / "small" / "config.json", {"policy": policy_spec(policy)})
    save_weights(tmp_path / "small" / "model.safetensors", policy)
    monkeypatch.setattr(locate, "_WEIGHTS", tmp_path)
    return tmp_path


def test_one_line_loads_the_committed_policies():
    assert {"expert-g1", "dagger-g1", "plat-g1"} <= set(shipped_runs())
    policy = plat.load("plat-g1")
    assert policy.robot is G1
    assert policy.deployed().out_keys == ["action"]


def test_a_policy_for_robots_comes_with_scores():
    scores = SavedRun(shipped_runs()["imagined-robot-g1"]).scores
    assert scores
    assert {score.horizon for score in scores} >= {"single", "long", "mixed"}


def test_an_installed_package_has_its_own(installed):
    assert list(shipped_runs()) == ["small-g1"]
    assert load_shipped("small-g1").config.hidden == (8,)


def test_another_name_is_answered_with_those_that_exist(installed):
    with pytest.raises(CheckpointError, match="no weights called 'plat' come with plat, only 'small-g1'"):
        plat.load("plat")


def test_a_path_is_answered_with_what_loads_it(installed, tmp_path):
    with pytest.raises(CheckpointError, match=r"plat\.runs\.load_policy loads a run by its path"):
        plat.load(tmp_path)


def test_a_device_that_is_not_there_is_named():
    with pytest.raises(ConfigError, match="'nowhere': not on this machine"):
        plat.load("plat-g1", device="nowhere")


def test_an_installation_without_weights_says_so(installed):
    shutil.rmtree(installed / "small")
    with pytest.raises(CheckpointError, match="only none: this installation of plat has no weights"):
        plat.load("plat-g1")
