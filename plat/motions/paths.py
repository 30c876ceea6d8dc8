"""Files that paths, folders and globs name."""

import glob
import re
from collections.abc import Collection, Sequence
from pathlib import Path

from plat.errors import MotionError

__all__ = ["find_files", "is_named"]

# what file managers add to the name of a copy
_COPY = re.compile(r"(?: ?\(\d+\)|(?: - |[ _-])(?:copy|kopie|copie)(?: ?\(?\d+\)?)?)$", re.IGNORECASE)


def find_files(patterns: str | Path | Sequence[str | Path], endings: Collection[str]) -> list[Path]:
    """Return the files that paths, folders and globs name, without repeats, in sorted order for each.

    Hidden files and folders, and copies of a file such as ``walk (1).npz`` beside an equal ``walk.npz``, are left out
    of what folders hold.

    Args:
        patterns: a path, a folder, a glob, or several of these.
        endings: of the files to look for, in small letters.

    Raises:
        MotionError: when one of them names no such file, or another kind of file.
    """
    paths: list[Path] = []
    expected = ", ".join(endings)
    for pattern in [patterns] if isinstance(patterns, (str, Path)) else patterns:
        path = Path(pattern).expanduser()
        if path.is_dir():
            found = sorted(file for file in path.rglob("*") if file.suffix.lower() in endings)
            found = [file for file in found if not any(part.startswith(".") for part in file.relative_to(path).parts)]
            found = [file for file in found if not _is_copy(file)]
        elif path.exists():
            found = [path]
        else:
            found = sorted(Path(name) for name in glob.glob(str(path), recursive=True))
        if not found:
            raise MotionError(
                f"motion file {str(pattern)!r}: no such file, folder with motion files ({expected}) or glob"
            )
        for path in found:
            if path.suffix.lower() not in endings or not path.is_file():
                raise MotionError(f"motion file {str(path)!r}: not a motion file, expected one of {expected}")
        paths += [path for path in found if path not in paths]
    return paths


def is_named(path: Path, patterns: str | Path | Sequence[str | Path]) -> bool:
    """Return whether one of the patterns is the path itself, and no folder or glob that holds it."""
    listed = [patterns] if isinstance(patterns, (str, Path)) else patterns
    return any(Path(pattern).expanduser() == path for pattern in listed)


def _is_copy(path: Path) -> bool:
    if not _COPY.search(path.stem):
        return False
    original = path.with_name(_COPY.sub("", path.stem) + path.suffix)
    return original.is_file() and original.read_bytes() == path.read_bytes()
