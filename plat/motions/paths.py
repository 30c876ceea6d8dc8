"""Files that paths, folders and globs name."""

import glob
import hashlib
import itertools
import os
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

from plat.errors import MotionError
from plat.files import as_path, expand_home

__all__ = ["distinct_names", "find_files", "listed_paths", "names_apart", "patterns_in", "read_twice"]

# what to do with files of other kinds, by their endings
_INSTEAD = {
    ".fbx .glb .gltf .c3d .trc .usd .usda .vmd .blend": "export it as .bvh, for instance with Blender",
    ".rrd": "export it to a table (.csv), or take the data set's own tables",
    ".pt .pth .ckpt .motion": "a file of PyTorch: load it there and write its arrays with np.savez",
    ".asf": "a skeleton: name the .amc files beside it",
    ".h5 .hdf5 .parquet .feather .mcap .bag .db3 .mat": "write root, joints and fps with np.savez, or a table (.csv)",
    ".zip .tar .gz .tgz .7z .rar .zst": "unpack it first",
    ".xml .mjcf": "keys of a model become keyframes: plat keyframes convert",
    ".json .yaml .yml": "keyframes are for plat play --keyframes; of motions write root, joints and fps with np.savez",
    ".mp4 .mov .avi .mkv": "a video: motion is estimated from it by other programs, such as GVHMR",
}

# what file managers add to the name of a copy
_COPY = re.compile(r"(?: ?\(\d+\)|(?: - |[ _-])(?:copy|kopie|copie)(?: ?\(?\d+\)?)?)$", re.IGNORECASE)


def find_files(
    patterns: str | Path | Sequence[str | Path],
    endings: Collection[str],
    *,
    named: Collection[str] = (),
    copies: bool = False,
    told: list[str] | None = None,
    twice: list[tuple[Path, Path]] | None = None,
) -> list[Path]:
    """Return the files that paths, folders and globs name, without repeats, in sorted order for each.

    Hidden files and folders, and copies of a file such as ``walk (1).npz`` beside an equal ``walk.npz``, are left out
    of what folders hold. Equal files that are not named as copies are taken, and told of. Links to folders are
    followed, but none is gone through twice.

    Args:
        patterns: a path, a folder, a glob, or several of these.
        endings: of the files to look for, in small letters.
        named: those of them that folders are not searched for.
        copies: take copies as well.
        told: is given a line for each copy that was left out.
        twice: is given each file that is equal to one before it and was taken, with that one.

    Raises:
        MotionError: when one of them names no such file, or another kind of file.
    """
    paths: dict[Path, None] = {}  # in order; shells turn a glob into thousands of patterns
    sought = [ending for ending in endings if ending not in named]
    expected = ", ".join(sought)
    for pattern in patterns_in(patterns):
        path = expand_home(as_path(pattern, "motion file", MotionError))
        if os.path.isdir(path):  # false for a name that is too long, too
            # folders may be called like files, and links of a store lead nowhere until what they stand for is there
            every = sorted(file for file in _below(path) if file.suffix.lower() in sought)
            found = _without_lost(every, copies, told)
            found = found if copies else _without_copies(found, told, twice)
        elif os.path.exists(path):
            found = [path]
        else:
            every = sorted(Path(name) for name in glob.glob(str(path), recursive=True))
            found = _without_lost(every, copies, told) or every
        if not found:
            raise MotionError(
                f"motion file {str(pattern)!r}: no such file, folder with motion files ({expected}) or glob"
            )
        for path in found:
            if path.suffix.lower() not in endings or not path.is_file():
                instead = next((f"; {what}" for kinds, what in _INSTEAD.items() if _ending(path) in kinds.split()), "")
                raise MotionError(f"motion file {str(path)!r}: not a motion file, expected one of {expected}{instead}")
        paths |= dict.fromkeys(found)
    return list(paths)


def listed_paths(patterns: str | Path | Sequence[str | Path]) -> set[Path]:
    """Return the paths that patterns are themselves: files among them are named, and not found in a folder or glob."""
    return {expand_home(Path(pattern)) for pattern in patterns_in(patterns)}


def patterns_in(patterns: str | Path | Iterable[str | Path]) -> list[str | Path]:
    """Return a path, or several, as a list.

    Raises:
        MotionError: for what is neither.
    """
    several = isinstance(patterns, Iterable) and not isinstance(patterns, str)
    return list(patterns) if several else [as_path(patterns, "motion file", MotionError)]  # type: ignore[arg-type]


def names_apart(paths: Sequence[Path]) -> list[str]:
    """Return a name for each file: its own without the ending, with its folder's before it where several are alike.

    A number stands behind a name that is taken all the same.

    >>> names_apart([Path("a/walk.bvh"), Path("b/walk.bvh"), Path("b/run.bvh")])
    ['a_walk', 'b_walk', 'run']
    >>> names_apart([Path("x/a/walk.bvh"), Path("y/a/walk.bvh"), Path("a_walk_2.bvh")])
    ['a_walk', 'a_walk_2', 'a_walk_2_2']
    """
    count = Counter(path.stem for path in paths)
    return distinct_names([path.stem if count[path.stem] == 1 else f"{path.parent.name}_{path.stem}" for path in paths])


def distinct_names(names: Sequence[str]) -> list[str]:
    """Return the names with a number behind one that was there before.

    >>> distinct_names(["a", "a", "a_2", "b", "a"])
    ['a', 'a_2', 'a_2_2', 'b', 'a_3']
    """
    taken: set[str] = set()
    numbers: defaultdict[str, Iterator[int]] = defaultdict(lambda: itertools.count(2))
    found = []
    for name in names:
        free = name
        while free in taken:
            free = f"{name}_{next(numbers[name])}"
        taken.add(free)
        found.append(free)
    return found


def read_twice(pair: tuple[Path, Path]) -> str:
    """Return the line about a file and an equal one before it.

    >>> read_twice((Path("b.npz"), Path("a.npz")))
    'read twice: b.npz is the same as a.npz'
    """
    return f"read twice: {pair[0]} is the same as {pair[1]}"


def _below(folder: Path) -> Iterator[Path]:
    """Yield the files below a folder, and links to what is not there, but nothing that is hidden.

    Folders that links lead to are gone through when all others are, and none twice: a link to what holds the folder
    itself would lead back to it.
    """
    root = os.path.join(os.path.realpath(folder), "")
    seen: set[str] = set()
    waiting = [str(folder)]
    while waiting:
        for at, folders, files in os.walk(waiting.pop(0)):
            place = os.path.realpath(at)
            if place in seen:
                folders.clear()
                continue
            seen.add(place)
            shown = sorted(name for name in folders if not name.startswith("."))
            linked = [os.path.join(at, name) for name in shown if os.path.islink(os.path.join(at, name))]
            waiting += [link for link in linked if not root.startswith(os.path.join(os.path.realpath(link), ""))]
            folders[:] = [name for name in shown if os.path.join(at, name) not in linked]
            yield from (Path(at, name) for name in files if not name.startswith("."))


def _without_lost(paths: list[Path], strict: bool, told: list[str] | None) -> list[Path]:
    """Return those that are files; links whose files are not there are told of.

    Raises:
        MotionError: for such a link where there is nothing else, or where the user is strict.
    """
    found = [path for path in paths if path.is_file()]
    lost = [path for path in paths if path.is_symlink() and not path.exists()]
    if lost:
        more = f" and {len(lost) - 1} more" if len(lost) > 1 else ""
        what = "links to what is not there" if more else "a link to what is not there"
        if strict or not found:
            raise MotionError(f"motion file {str(lost[0])!r}{more}: {what}: get it first, as with git annex or dvc")
        if told is not None:
            told.append(f"ignored: {lost[0]}{more}, {what}")
    return found


def _ending(path: Path) -> str:
    return path.suffix.lower()


def _without_copies(paths: list[Path], told: list[str] | None, twice: list[tuple[Path, Path]] | None) -> list[Path]:
    """Return the files without those that are named as copies of an equal file beside them."""
    kept: list[Path] = []
    known: dict[bytes, Path] = {}
    sizes = Counter(path.stat().st_size for path in paths if path.is_file())
    for path in paths:
        if not path.is_file() or sizes[path.stat().st_size] == 1:
            kept.append(path)
            continue
        original = path.with_name(_COPY.sub("", path.stem) + path.suffix)
        copy = original != path and original.is_file()
        if twice is None and not copy:  # equal files are only told of, and to read them all takes long
            kept.append(path)
            continue
        digest = _digest(path)
        if copy and _digest(original) == digest:
            if told is not None:
                told.append(f"ignored: {path}, a copy of {original.name}")
            continue
        kept.append(path)
        if known.setdefault(digest, path) != path and path.stat().st_size and twice is not None:
            twice.append((path, known[digest]))
    return kept


def _digest(path: Path) -> bytes:
    digest = hashlib.blake2b()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.digest()
