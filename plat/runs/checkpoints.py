"""Checkpoints of a run: written whole, with hashes, the last two kept."""

import hashlib
import pickle
import re
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from torchrl.checkpoint import Checkpoint, CheckpointRotation, StateDictCheckpointAdapter
from torchrl.checkpoint import CheckpointError as TorchRLCheckpointError

from plat.errors import CheckpointError
from plat.files import is_full

__all__ = ["Checkpoints", "UnfitCheckpointError"]

_HASH_SUFFIX = ".blake2b"
_CUT = re.compile("inline_container|PytorchStreamWriter|iostream error")
"""Torch's words of a file that was not written to its end."""
_LONGEST = 400
"""Letters of a reason that are shown."""


class UnfitCheckpointError(CheckpointError):
    """Checkpoint that is whole, and that what is to be restored does not fit."""

    def __init__(self, path: Path, reason: str):
        super().__init__(f"{str(path)!r}: this checkpoint cannot be resumed from ({reason})")
        self.reason = reason


class Checkpoints:
    """Checkpoints in a folder, on TorchRL's ``CheckpointRotation``. Each file has a hash beside it.

    Args:
        folder: the folder.
        components: by name, objects with ``state_dict`` and ``load_state_dict``.
    """

    def __init__(self, folder: Path, components: Mapping[str, Any]):
        self._folder = folder
        self._rotation = CheckpointRotation(folder, keep_last=2)
        self._checkpoint = Checkpoint()
        # plain files in torch's own format, read back with weights_only: a full disk is then an error and not a
        # crash, and loading runs no code
        adapter = _HashedAdapter(payload_format="torch")
        for name, component in components.items():
            self._checkpoint.register(name, component, adapter=adapter)

    def all(self) -> list[Path]:
        """Return the checkpoints that are there, damaged ones too, the newest first."""
        if not self._folder.is_dir():
            return []
        found = [path for path in self._folder.glob("checkpoint-*") if path.name.rpartition("-")[2].isdigit()]
        return sorted(found, key=lambda path: int(path.name.rpartition("-")[2]), reverse=True)

    def save(self, step: int) -> None:
        """Write a checkpoint, and remove all but the last two.

        Raises:
            CheckpointError: when the disk does not take it, or a component's state could not be read again; those that
                were there are intact.
        """
        try:
            self._rotation.save(self._checkpoint, step=step)
        except (OSError, RuntimeError) as error:
            reason = "no space left on device" if is_full(self._folder.parent) else str(error)
            if _CUT.search(reason):  # what the disk took of it is free again by now
                reason = "the disk did not take all of it: it may be full"
            before = (
                "the one before it is intact, go on from it with --resume" if self.all() else "there is none before it"
            )
            raise CheckpointError(
                f"{str(self._folder)!r}: a checkpoint could not be written ({reason}); {before}"
            ) from error

    def load(self) -> Path | None:
        """Restore the components from the newest checkpoint that is whole and fits; None where there is no checkpoint.

        Another one is said, and renamed when an older one is taken.

        Raises:
            CheckpointError: when none is whole.
            UnfitCheckpointError: when none that is whole fits.
        """
        damaged: dict[Path, str] = {}
        unfit: UnfitCheckpointError | None = None
        for path in self.all():
            problem = next(_problems(path), None)
            if problem is None:
                try:
                    self._load(path)
                except UnfitCheckpointError as error:  # its manifest may be what is damaged
                    unfit, problem = unfit or error, error.reason
            if problem is not None:
                damaged[path] = problem
                continue
            for other, what in damaged.items():
                print(f"{str(other)!r} is damaged ({what}): going on from the checkpoint before it", flush=True)
                aside = other.with_name(f"damaged-{other.name}")
                shutil.rmtree(aside, ignore_errors=True)
                other.rename(aside)
            return path
        if unfit is not None:
            raise unfit
        if damaged:
            reasons = "; ".join(f"{path.name}: {what}" for path, what in damaged.items())
            raise CheckpointError(f"{str(self._folder)!r}: no checkpoint can be resumed from ({reasons})")
        return None

    def _load(self, path: Path) -> None:
        try:
            self._checkpoint.load(path, map_location="cpu")
        except (TorchRLCheckpointError, OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
            raise UnfitCheckpointError(path, _reason(error)) from error

    def clear_leftovers(self) -> None:
        """Remove what a killed process did not finish writing, and put back what it was about to replace."""
        for backup in self._folder.glob(".checkpoint-*.backup-*"):
            place = self._folder / backup.name.removeprefix(".").partition(".")[0]
            if not place.exists():
                backup.rename(place)
        for leftover in self._folder.glob(".*"):
            shutil.rmtree(leftover, ignore_errors=True)


class _HashedAdapter(StateDictCheckpointAdapter):
    """Adapter that writes the hash of a component's file beside it, before the checkpoint is published."""

    def save(self, component: Any, path: Path, *, args: tuple[Any, ...], kwargs: Mapping[str, Any]) -> Any:
        state = super().save(component, path, args=args, kwargs=kwargs)
        file = path / self.state_torch
        _check_readable(file, re.sub(r"^\d+-", "", path.name))
        file.with_name(file.name + _HASH_SUFFIX).write_text(_hash(file))
        return state


def _check_readable(file: Path, name: str) -> None:
    """Check that a component's file can be read again, which runs no code; the numbers of tensors are not read.

    Raises:
        CheckpointError: naming what it holds that cannot.
    """
    try:
        torch.load(file, map_location="cpu", mmap=True, weights_only=True)
    except pickle.UnpicklingError as error:
        found = re.search(r"(?:GLOBAL|class) ([\w.]+)", str(error))
        what = "objects" if found is None else found[1]
        raise CheckpointError(
            f"state {name!r}: its state_dict() holds {what}, which a run does not read again; expected tensors, "
            "numbers and texts of Python, lists and dictionaries of these"
        ) from None
    except (OSError, RuntimeError):  # a disk that maps no files
        return


def _reason(error: Exception) -> str:
    """Return in one line why a component could not be restored; torch takes several."""
    told = " ".join(str(error).split()).removeprefix("Failed to load checkpoint component ") or type(error).__name__
    if isinstance(error.__cause__, KeyError):
        told = told.removesuffix(f": {error.__cause__}") + f" lacks {error.__cause__}"
    return told if len(told) <= _LONGEST else f"{told[:_LONGEST]} ..."


def _problems(path: Path) -> Iterator[str]:
    """Yield what is wrong with the files of a checkpoint; one without hashes is of an older plat."""
    try:
        manifest = Checkpoint.manifest(path)
        for name, record in manifest["components"].items():
            for file in record["files"]:
                found = path / record["path"] / file
                if not found.exists():
                    yield f"{name}: {file} is missing"
                    continue
                noted = found.with_name(found.name + _HASH_SUFFIX)
                if noted.exists() and noted.read_text().strip() != _hash(found):
                    yield f"{name}: {file} is not what was written"
    except (TorchRLCheckpointError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        yield str(error).splitlines()[0] if str(error) else type(error).__name__


def _hash(path: Path) -> str:
    digest = hashlib.blake2b(digest_size=32)
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
