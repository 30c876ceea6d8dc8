"""The Hugging Face Hub, stood in for by a folder: the client's functions with the client's arguments."""

import errno
import shutil
import sys
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import ModuleType

import pytest
import torch

import plat
from plat.errors import CheckpointError, OutputError
from plat.export import push_run
from plat.modules import DynamicsConfig, DynamicsModel
from plat.robots import G1
from plat.runs import SavedRun, download_run, load_dynamics, run_folder, save_dynamics, upload_run
from plat.runs.hub import hub_name, repository_name
from tests.export.runs import small_policy, write_run


@pytest.fixture
def hub(tmp_path, monkeypatch) -> Path:
    """The folder in which repositories are."""
    folder = tmp_path / "hub"

    class HfApi:
        def create_repo(self, repo_id, *, private=None, exist_ok=False):
            (folder / repo_id).mkdir(parents=True, exist_ok=exist_ok)
            (folder / repo_id / ".private").write_text(str(private))

        def upload_folder(self, *, repo_id, folder_path, commit_message=None):
            shutil.copytree(folder_path, folder / repo_id, dirs_exist_ok=True)

    def snapshot_download(repo_id, *, revision=None, allow_patterns=None):
        if not (folder / repo_id).is_dir() or revision not in (None, "main"):
            raise FileNotFoundError(f"404: {repo_id}\nask someone else")
        cache = tmp_path / "cache" / f"models--{repo_id.replace('/', '--')}" / "snapshots" / ("0a1b" * 10)
        for path in (folder / repo_id).iterdir():
            if any(fnmatch(path.name, pattern) for pattern in allow_patterns):
                cache.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, cache / path.name)
        cache.mkdir(parents=True, exist_ok=True)
        return str(cache)

    module = ModuleType("huggingface_hub")
    module.HfApi, module.snapshot_download = HfApi, snapshot_download
    monkeypatch.setitem(sys.modules, "huggingface_hub", module)
    return folder


@pytest.fixture
def run(tmp_path) -> Path:
    run = write_run(tmp_path / "run", small_policy("plain"))
    (run / "evaluation.csv").write_text("policy,horizon,metric,value,low,high\nrun,long,tks,99.5,99.25,99.75\n")
    (run / "secret.txt").write_text("not to be uploaded")
    return run


def test_what_is_pushed_is_loaded_the_same(hub, run):
    push_run(run, "hf:someone/walker")
    names = sorted(path.name for path in (hub / "someone" / "walker").iterdir())
    assert names == [".private", "README.md", "config.json", "evaluation.csv", "model.safetensors"]
    assert (hub / "someone" / "walker" / ".private").read_text() == "True"
    card = (hub / "someone" / "walker" / "README.md").read_text()
    assert card.startswith("---\nlibrary_name: plat-rl\n")
    assert 'plat.load("hf:someone/walker")' in card
    assert "| long | 99.5 (99.2-99.8) |" in card
    ours, theirs = SavedRun(run).policy(), plat.load("hf:someone/walker@main")
    for name, value in ours.state_dict().items():
        assert torch.equal(value, theirs.state_dict()[name])
    # every command that takes a run takes its name
    fetched = SavedRun(run_folder("hf:someone/walker"))
    assert fetched.scores == SavedRun(run).scores
    assert fetched.name == "walker"  # not the hash that its folder is called by


def test_a_learned_model_and_scores_from_a_table_beside_the_run_go_with_it(hub, run):
    (run / "evaluation.csv").unlink()
    rows = "policy,horizon,seeds,metric,value,low,high\nother,long,1,tks,1,1,1\nrun,long,1,tks,99.5,99.25,99.75\n"
    (run.parent / "evaluation.csv").write_text(rows)
    model = DynamicsModel(G1, DynamicsConfig(hidden=(8,)))
    save_dynamics(run, model)
    push_run(run, "hf:someone/walker")
    fetched = SavedRun("hf:someone/walker")
    assert fetched.scores == SavedRun(run).scores
    assert [score.value for score in fetched.scores] == [99.5]
    loaded = load_dynamics("hf:someone/walker", G1)
    assert all(torch.equal(value, loaded.state_dict()[name]) for name, value in model.state_dict().items())


def test_a_path_of_windows_names_the_same_repository():
    assert hub_name(PureWindowsPath("hf:someone/walker@main")) == "hf:someone/walker@main"
    assert hub_name(PurePosixPath("hf:someone/walker")) == "hf:someone/walker"
    assert hub_name(PureWindowsPath(r"C:\runs\walker")) is None


@pytest.mark.parametrize("folder", ["runs/plat", "snapshots/plat", "models--a/plat", "datasets--a--b/snapshots/0a"])
def test_other_folders_are_no_repository(folder):
    assert repository_name(PurePosixPath(folder)) is None


@pytest.mark.parametrize("name", ["hf:", "hf:walker", "hf:a/b/c", "hf:../x y", "hf:a/b@", "someone/walker"])
def test_names_of_another_form(hub, name):
    with pytest.raises(CheckpointError, match="names no repository, expected 'hf:owner/name'"):
        download_run(name)


def test_what_the_hub_refuses_is_one_line(hub, run):
    with pytest.raises(CheckpointError, match=r"'hf:a/b' could not be downloaded \(FileNotFoundError: 404: a/b\)"):
        plat.load("hf:a/b")
    (hub / "a" / "b").mkdir(parents=True)
    with pytest.raises(CheckpointError, match=r"'hf:a/b' holds no config.json"):
        plat.load("hf:a/b")
    with pytest.raises(CheckpointError, match="a revision cannot be uploaded"):
        upload_run(run, "hf:a/b@main", "")
    with pytest.raises(CheckpointError, match="holds no config.json, expected a run directory"):
        upload_run(hub, "hf:a/b", "")


def test_a_full_disk_is_not_blamed_on_the_run(hub, run, monkeypatch):
    def full(self, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputError, match=r"^a copy '.*config\.json': cannot be written: No space left") as raised:
        upload_run(run, "hf:a/b", "")
    assert str(run) not in str(raised.value)


def test_without_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(CheckpointError, match=r"the Hugging Face Hub needs: pip install 'plat-rl\[hub\]'"):
        plat.load("hf:a/b")
