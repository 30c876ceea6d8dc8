"""Runs on the Hugging Face Hub: download by name, and upload with a card."""

import re
import tempfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path, PurePath
from typing import Any

from plat.errors import CheckpointError
from plat.extras import importing
from plat.files import copy_file, replace_table, write_file

__all__ = ["HUB_PREFIX", "download_run", "hub_name", "repository_name", "upload_run"]

HUB_PREFIX = "hf:"
"""Before the name of a repository: ``"hf:owner/name"`` or ``"hf:owner/name@revision"``."""
# Settings and weights, without which there is no run; a learned model of the robot; scores.
_FILES = ["config.json", "model.safetensors", "dynamics.safetensors", "evaluation.csv"]
_SCORES = _FILES[3]
_COLUMNS = ("policy", "horizon", "metric", "value", "low", "high")
_NAME = re.compile(r"[\w.-]{1,96}/[\w.-]{1,96}(@[\w./-]{1,96})?", re.ASCII)


def download_run(name: str) -> Path:
    """Return the folder of a run that is downloaded from the Hub, or was before.

    Settings and weights are data: nothing of what is downloaded is executed.

    Args:
        name: ``"hf:owner/name"``, with ``"@revision"`` behind it for a branch, tag or commit.

    Raises:
        CheckpointError: for a name of another form, when huggingface-hub is not installed, or the Hub does not
            give the files.
    """
    repo, _, revision = _checked(name).partition("@")
    hub = _huggingface_hub()
    try:
        folder = Path(hub.snapshot_download(repo, revision=revision or None, allow_patterns=_FILES))
    except Exception as error:  # the client has a class of its own for every kind of failure
        raise CheckpointError(f"{name!r} could not be downloaded ({_one_line(error)})") from error
    if not (folder / _FILES[0]).is_file():
        raise CheckpointError(f"{name!r} holds no {_FILES[0]}, expected a run that plat.runs.upload_run wrote")
    return folder


def hub_name(run: str | PurePath) -> str | None:
    """Return the name on the Hub that is meant by a run's; None where it is that of a folder.

    A path of Windows has backslashes for the slashes of the name.

    >>> from pathlib import PureWindowsPath
    >>> hub_name(PureWindowsPath("hf:owner/name")), hub_name("runs/plat")
    ('hf:owner/name', None)
    """
    name = run.as_posix() if isinstance(run, PurePath) else run
    return name if name.startswith(HUB_PREFIX) else None


def repository_name(folder: PurePath) -> str | None:
    """Return the name, without its owner, of the repository that a folder of the client's cache is a snapshot of.

    The folder itself is called by the hash of a commit. None for other folders.

    >>> repository_name(Path("hub/models--owner--walker/snapshots/0a1b2c"))
    'walker'
    >>> repository_name(Path("runs/plat"))
    """
    kind, _, name = folder.parent.parent.name.partition("--")
    return name.rpartition("--")[2] if kind == "models" and folder.parent.name == "snapshots" else None


def upload_run(
    run: str | Path, name: str, card: str, *, private: bool = True, scores: Sequence[Sequence[object]] = ()
) -> None:
    """Upload config, weights, learned model and scores of a run to the Hub, with a card.

    Log in first: ``hf auth login``.

    Args:
        run: its directory.
        name: ``"hf:owner/name"``; the repository is made if it is not there.
        card: Markdown, for example of :func:`plat.export.card.run_card`.
        private: whether a new repository is private.
        scores: rows of the run in a table beside its directory, such as :attr:`plat.runs.SavedRun.scores`; they are
            uploaded where the directory has no table of its own.

    Raises:
        CheckpointError: for a name of another form, a directory without a run, when huggingface-hub is not
            installed, or the Hub does not take the files.
        OutputError: when the disk does not take a copy of them.
    """
    repo, _, revision = _checked(name).partition("@")
    if revision:
        raise CheckpointError(f"{name!r}: a revision cannot be uploaded, expected 'hf:owner/name'")
    missing = [file for file in _FILES[:2] if not (Path(run) / file).is_file()]
    if missing:
        raise CheckpointError(f"{str(run)!r} holds no {missing[0]}, expected a run directory")
    hub = _huggingface_hub()
    with tempfile.TemporaryDirectory() as folder:
        for file in _FILES:
            if (Path(run) / file).is_file():
                copy_file(Path(run) / file, Path(folder) / file, "a copy")
        if scores and not (table := Path(folder) / _SCORES).exists():
            rows = [(repo.partition("/")[2], *row) for row in scores]
            write_file(table, lambda part: replace_table(part, _COLUMNS, rows), "the scores")
        write_file(Path(folder) / "README.md", lambda part: part.write_text(card, encoding="utf-8"), "the card")
        try:
            api = hub.HfApi()
            api.create_repo(repo, private=private, exist_ok=True)
            api.upload_folder(repo_id=repo, folder_path=folder, commit_message="Upload a policy of plat")
        except Exception as error:  # as above
            raise CheckpointError(f"{name!r} could not be uploaded ({_one_line(error)})") from error


def _checked(name: str) -> str:
    repo = name.removeprefix(HUB_PREFIX)
    if not name.startswith(HUB_PREFIX) or not _NAME.fullmatch(repo):
        raise CheckpointError(f"{name!r} names no repository, expected 'hf:owner/name' or 'hf:owner/name@revision'")
    return repo


def _huggingface_hub() -> Any:
    with importing("hub", "the Hugging Face Hub needs", CheckpointError):
        return import_module("huggingface_hub")  # type checkers know it only where it is installed


def _one_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
