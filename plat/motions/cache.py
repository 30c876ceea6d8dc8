"""Cache of motion libraries: one file for each, which is memory-mapped, and digests of large sets of motion files."""

import hashlib
import json
import logging
import os
import struct
import tempfile
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from plat.files import clear_parts, expand_home, replace_file

__all__ = [
    "CODE",
    "CODE_DIGEST",
    "CachedTable",
    "cache_dir",
    "code_digest",
    "file_digests",
    "read_table",
    "write_table",
]

_LOGGER = logging.getLogger("plat.motions")

# Bytes before the first row: length of the header, and the header with blanks behind it. Rows begin on a page.
_HEAD = 4096

_TENSORS = ("table", "clip_start", "clip_length", "clip_names", "facts")

# From this size on, a file that has not been touched since it was found whole is not read through again, and a set of
# motion files that has not been touched is not either.
_LARGE = 1 << 28

CODE = ("motions", "robots", "rotations.py", "rotations_np.py", "spec/proportions.py")
"""Files and folders of plat that say what a motion file or a generated motion becomes."""


def code_digest(package: Path) -> str:
    """Return a digest of :data:`CODE` in a folder."""
    digest = hashlib.blake2b(digest_size=16)
    for found in (package / name for name in CODE):
        for path in sorted(found.rglob("*")) if found.is_dir() else [found]:
            if path.suffix in (".py", ".yaml"):
                content = path.read_bytes()
                digest.update(f"{path.relative_to(package).as_posix()} {len(content)} ".encode() + content)
    return digest.hexdigest()


CODE_DIGEST = code_digest(Path(__file__).parents[1])
"""Part of every cache key: what other code made is not found. It is of the code that this process runs, hence here."""

# A file can change twice within the resolution of its times (s).
_SETTLED = 2.0


def cache_dir() -> Path:
    """Return the cache folder: ``$PLAT_CACHE_DIR``, else ``plat`` in the user's cache folder or a temporary one."""
    if folder := os.environ.get("PLAT_CACHE_DIR"):
        return expand_home(Path(folder))  # no shell has seen it where a service or a file of variables sets it
    # a relative one is invalid: XDG Base Directory Specification
    if os.path.isabs(folder := os.environ.get("XDG_CACHE_HOME", "")):
        return Path(folder) / "plat"
    try:
        return Path.home() / ".cache" / "plat"
    except RuntimeError:  # a user without a home folder, as in containers
        return Path(tempfile.gettempdir()) / "plat"


@dataclass(frozen=True)
class CachedTable:
    """Table of frames in a cache file, memory-mapped: rows are read from disk when they are first looked at.

    Attributes:
        rows: ``[F, W]``.
        start, length: first frame and number of frames of each clip ``[C]``.
        names: of the clips.
        dt: seconds from frame to frame.
        facts: what else was written with it.
    """

    rows: Tensor
    start: Tensor
    length: Tensor
    names: list[str]
    dt: float
    facts: dict[str, Any]


def write_table(
    path: Path,
    width: int,
    dt: float,
    build: Callable[[Callable[[Tensor], object]], tuple[Tensor, Tensor, Sequence[str], dict[str, Any]]],
) -> None:
    """Write a table whole or not at all, as it is built.

    Args:
        path: the file.
        width: number of values of a row.
        dt: seconds from frame to frame.
        build: is given what takes rows ``[n, W]``, and returns start and length of each clip, the names, and facts.

    Raises:
        OSError: when the disk does not take it. Whatever ``build`` raises goes through.
    """

    def write(part: Path) -> None:
        with part.open("wb") as file:
            file.write(bytes(_HEAD))
            written = _Written(file)
            start, length, names, facts = build(written.take)
            rows = written.size // (4 * width)
            tensors = {"table": ("F32", [rows, width], 0, written.size)}
            for name, dtype, tensor in (
                ("clip_start", "I64", start),
                ("clip_length", "I64", length),
                ("clip_names", "U8", _as_tensor(names)),
                ("facts", "U8", _as_tensor(facts)),
            ):
                begin = written.size
                written.take(tensor)
                tensors[name] = (dtype, list(tensor.shape), begin, written.size)
            header: dict[str, Any] = {
                name: {"dtype": dtype, "shape": shape, "data_offsets": [begin, end]}
                for name, (dtype, shape, begin, end) in tensors.items()
            }
            checksum = f"{written.checksum:08x}"
            header["__metadata__"] = {"dt": repr(dt), "checksum": checksum}
            text = json.dumps(header).encode().ljust(_HEAD - 8)
            file.seek(0)
            file.write(struct.pack("<Q", len(text)) + text)

    clear_parts(path.parent)  # a killed process may have left gigabytes
    replace_file(path, write)
    if path.stat().st_size >= _LARGE:
        _remember_whole(path)


def _as_tensor(value: object) -> Tensor:
    """Return a value as JSON in bytes. The header has a fixed size, and what can be of any goes behind the table."""
    return torch.frombuffer(bytearray(json.dumps(value).encode()), dtype=torch.uint8)


class _Written:
    """File that counts and adds up what is written."""

    def __init__(self, file: BinaryIO):
        self._file = file
        self.size = 0
        self.checksum = 0

    def take(self, tensor: Tensor) -> None:
        """Write the values of a contiguous tensor."""
        values = tensor.numpy().data
        self._file.write(values)
        self.size += values.nbytes
        self.checksum = zlib.crc32(values, self.checksum)


def read_table(path: Path) -> CachedTable | None:
    """Return a table, or None where there is none, or a damaged one.

    A small file is read through, and a large one the first time that it is met.
    """
    try:
        if not path.exists():
            return None
        with safe_open(path, "pt") as file:
            metadata = file.metadata()
            tensors = [file.get_tensor(name) for name in _TENSORS]
        if not (path.stat().st_size >= _LARGE and _is_known_whole(path)):
            checksum = 0
            for tensor in tensors:
                checksum = zlib.crc32(tensor.numpy().data, checksum)
            if metadata["checksum"] != f"{checksum:08x}":
                return None
            if path.stat().st_size >= _LARGE:
                _remember_whole(path)
        rows, start, length, names, facts = tensors
        return CachedTable(
            rows,
            start.clone(),
            length.clone(),
            json.loads(names.numpy().tobytes()),
            float(metadata["dt"]),
            json.loads(facts.numpy().tobytes()),
        )
    except (AttributeError, OSError, RuntimeError, SafetensorError, KeyError, ValueError, TypeError):
        return None


def _identity(path: Path) -> list[int]:
    """Return what changes with every change of a file: size, times and number."""
    stat = path.stat()
    return [stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino]


def _whole(path: Path) -> Path:
    return path.with_suffix(".whole.json")


def _remember_whole(path: Path) -> None:
    _write_quietly(_whole(path), json.dumps(_identity(path)))


def _is_known_whole(path: Path) -> bool:
    try:
        return bool(json.loads(_whole(path).read_text()) == _identity(path))
    except (OSError, ValueError):
        return False


def _write_quietly(path: Path, text: str) -> None:
    """Write what is only there to save time: a disk that does not take it costs that time."""
    try:
        replace_file(path, lambda part: part.write_text(text))
    except OSError as error:
        _LOGGER.debug("%r was not written (%s)", str(path), error.strerror)


def file_digests(paths: Sequence[Path], memory: Path) -> list[str]:
    """Return a digest of the content of each file.

    Those of a large set are kept in the file ``memory``. A file whose size, times and number are those of then is not
    read again.
    """
    identities = {path: _identity(path) for path in paths}
    large = sum(size for size, *_ in identities.values()) >= _LARGE
    known = _read_digests(memory) if large else {}
    found = {}
    latest = (time.time() - _SETTLED) * 1e9
    for path, identity in identities.items():
        before = known.get(str(path))
        found[path] = before[-1] if before is not None and before[:-1] == identity else _digest(path)
    if large:
        kept = {
            str(path): [*identity, found[path]]
            for path, identity in identities.items()
            if max(identity[1], identity[2]) < latest
        }
        if kept != known:
            _write_quietly(memory, json.dumps(kept))
    return [found[path] for path in paths]


def _read_digests(memory: Path) -> dict[str, list[Any]]:
    try:
        known = json.loads(memory.read_text())
    except (OSError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}


def _digest(path: Path) -> str:
    digest = hashlib.blake2b(digest_size=16)
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
