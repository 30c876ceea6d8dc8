"""Files that paths, folders and globs name."""

import glob
from collections.abc import Collection, Sequence
from pathlib import Path

from plat.errors import MotionError

__all__ = ["find_files"]


def find_files(patterns: str | Path | Sequence[str | Path], endings: Collection[str]) -> list[Path]:
    """Return the files that paths, folders and globs name, without repeats, in sorted order for each.

    Hidden files and folders are left out of what folders hold.

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
