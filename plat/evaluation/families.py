"""Families of motion, from the column of a manifest."""

import csv
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from plat.errors import RecordsError
from plat.files import as_path, readable, refuse_null
from plat.json_file import short
from plat.words import counted

__all__ = ["OTHER", "families_of", "read_manifest"]

OTHER = "other"
"""Family of clips that no manifest names."""


def read_manifest(paths: Iterable[Path], column: str = "family") -> dict[str, str]:
    """Return the family of each clip that manifests name.

    A manifest is a CSV file with the columns ``clip`` and ``family``, among others.

    Args:
        paths: of the files.
        column: with the families.

    Raises:
        RecordsError: naming the file that cannot be read, or lacks a column, and the clip that is of two families.
    """
    families: dict[str, str] = {}
    if not isinstance(column, str):
        raise RecordsError(f"read_manifest: column is {short(column)}, expected a text")
    for path in _paths("read_manifest: paths", paths):
        try:
            refuse_null(Path(path))
            with Path(path).open(newline="", encoding="utf-8-sig") as file:  # as spreadsheets write it
                rows = csv.DictReader(file)
                head = list(rows.fieldnames or ())
                missing = {"clip", column} - set(head)
                if missing:
                    raise RecordsError(f"manifest {str(path)!r}: no column {sorted(missing)}, it has {short(head)}")
                for row in rows:
                    if row["clip"] is None or row[column] is None:
                        raise RecordsError(
                            f"manifest {str(path)!r}, line {rows.line_num}: fewer cells than the head has"
                        )
                    clip, family = row["clip"], row[column]
                    if (before := families.setdefault(clip, family)) != family:
                        told = f"{column} of {short(clip)} is {short(family)}, and {short(before)} before"
                        raise RecordsError(f"manifest {str(path)!r}, line {rows.line_num}: {told}; expected one")
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise RecordsError(f"manifest {str(path)!r}: not a readable CSV file ({error})") from error
    return families


def families_of(clips: Sequence[str], families: dict[str, str], files: Iterable[Path] = ()) -> list[str]:
    """Return the family of each clip; :data:`OTHER` for those that are not in the manifest.

    Clips of one name in several files have that of their file or its folder before theirs, and are found by the rest.

    Args:
        clips: names.
        families: of the clips of manifests.
        files: that the clips are from.

    Raises:
        RecordsError: when no clip is in the manifest.

    >>> families_of(["a", "second_a", "b"], {"a": "walk"}, [Path("first.npz"), Path("second.npz")])
    ['walk', 'walk', 'other']
    """
    if isinstance(clips, str) or not isinstance(clips, Iterable) or not all(isinstance(clip, str) for clip in clips):
        raise RecordsError(f"families_of: clips is {short(clips)}, expected names")
    if not isinstance(families, Mapping):
        raise RecordsError(f"families_of: families is {short(families)}, expected families by the names of clips")
    files = _paths("families_of: files", files)
    prefixes = {f"{readable(name)}_" for path in files for name in (path.stem, path.absolute().parent.name)}
    found = [_family(clip, families, prefixes) for clip in clips]
    if found and not any(found):
        raise RecordsError(
            f"manifest: names none of the {counted(len(clips), 'clip')}, which are called {clips[0]!r} and so on"
        )
    return [family or OTHER for family in found]


def _paths(what: str, paths: Any) -> list[Path]:
    """Return paths as a list; one alone is a list of one."""
    given = [paths] if isinstance(paths, str | os.PathLike) else list(paths) if isinstance(paths, Iterable) else [paths]
    return [as_path(path, what, RecordsError) for path in given]


def _family(clip: str, families: dict[str, str], prefixes: Collection[str]) -> str | None:
    names = (clip, *(clip.removeprefix(prefix) for prefix in prefixes))
    return next((families[name] for name in names if name in families), None)
