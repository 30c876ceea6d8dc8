"""Candidates of a comparison, from what a command line names: runs, bundles and released trackers."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from plat.baselines import CATALOG, ReleasedTrackers, identify
from plat.baselines.catalog import sha256
from plat.deploy.runner import BUNDLE_FILE
from plat.errors import PlatError
from plat.evaluation import Entrant, Interface
from plat.evaluation.cells import Candidate, Cell, fingerprint
from plat.evaluation.setting import ReferenceView
from plat.export.data_sets import data_set_of
from plat.files import readable
from plat.robots import get_robot
from plat.runs.lineage import made_by, trained_on
from plat.runs.locate import CONFIG_FILE, is_run, run_folder, shipped_runs
from plat.runs.policies import Policy
from plat.runs.saved_run import WEIGHTS_FILE, SavedRun, load_policy
from plat.runs.user_modules import imported_code

__all__ = ["Loaded", "candidates_of", "trackers_of"]

Loaded: TypeAlias = dict[tuple[str, Path], Any]
"""Policies by name of a released tracker, or an empty one, and path."""

# of what is shown keyframes or a reference; records of those do not depend on how trackers are shown a keyframe
_NO_INTERFACE: tuple[Interface, ...] = ("next-frame",)


def candidates_of(
    paths: Sequence[Path],
    trackers: ReleasedTrackers,
    *,
    device: str = "cpu",
    dense: bool = False,
    interfaces: Sequence[Interface] = ("next-frame",),
    robot: str = "g1",
    loaded: Loaded | None = None,
    lists: Mapping[str, Sequence[str | Path]] | None = None,
) -> dict[Candidate, Entrant]:
    """Return every candidate with its policy, loaded. Dense trackers are there once for each interface.

    Args:
        paths: runs or names of shipped weights, bundles, and ``.onnx`` files of bundles or released trackers.
        trackers: further released trackers.
        device: of the policies.
        dense: show the reference motion in place of keyframes.
        interfaces: how dense trackers are shown a keyframe.
        robot: of bundles.
        loaded: policies of an earlier call, which are not loaded again; those that are loaded now are added.
        lists: by option, what was given to those that take several: runs that stand after one are among it.

    Raises:
        PlatError: when something cannot be loaded, an ``.onnx`` file is of no tracker that plat knows, or two have one
            name.
    """
    released = {name: path for name, path in trackers.files().items() if path is not None}
    loaded = {} if loaded is None else loaded
    paths = [path if path.name.strip(".") else path.resolve() for path in paths]  # "." has no name
    names = [readable(path.name) for path in paths]
    found: dict[Candidate, Entrant] = {}
    for path in paths:
        tracker = identify(path) if path.suffix == ".onnx" and path.is_file() else None
        if tracker is not None:
            other = released.setdefault(tracker.name, path)
            if other != path:
                raise PlatError(f"{tracker.name} is given twice, as {str(other)!r} and {str(path)!r}: one at a time")
            continue
        name = readable(path.name if names.count(readable(path.name)) == 1 else str(path))
        if path.suffix == ".onnx" or (path / BUNDLE_FILE).exists():
            shown = "bundle dense" if dense else "bundle"
            load = partial(_bundle, path, robot, dense)
            entrant = replace(_once_loaded(loaded, "", path, load), view=ReferenceView(dense))
            found[_candidate(name, load, _files(path), shown, "plat, a bundle")] = entrant
        else:
            policy = _once_loaded(loaded, "", path, partial(load_policy, path, device))
            found |= _of_run(name, path, device, dense, interfaces, policy)
    for name, path in released.items():
        files = CATALOG[name].paths(path)
        for interface in interfaces if not dense else interfaces[:1]:
            label = name if CATALOG[name].tested else f"{name} (unverified)"
            label = label if len(interfaces) == 1 or dense else f"{label}, {interface}"
            load = partial(_tracker, name, path, dense, interface)
            tracker = _once_loaded(loaded, name, path, partial(CATALOG[name].load, path))
            one = _candidate(label, load, files, f"{dense} {interface}", _described(name), "its owner's data")
            found[one] = Entrant.of_tracker(tracker, dense, interface)
    if not found:
        told = _swallowed(lists or {})
        raise PlatError(
            f"nothing to evaluate: give run directories, or files of released trackers (--trackers.twist2){told}"
        )
    return _told_apart(found)


def _swallowed(lists: Mapping[str, Sequence[str | Path]]) -> str:
    """Return which policy was taken for something else, as it stands after an option of several; empty for none."""
    for option, names in lists.items():
        for name in names:
            path = Path(name)
            if is_run(path) or (path / BUNDLE_FILE).exists() or path.suffix == ".onnx" or str(name) in shipped_runs():
                return f"; {str(name)!r} stands after {option} and was taken for one of it: put it first"
    return ""


def trackers_of(
    paths: Sequence[Path],
    trackers: ReleasedTrackers,
    *,
    device: str = "cpu",
    robot: str = "g1",
    loaded: Loaded | None = None,
) -> dict[Candidate, Entrant]:
    """Return the dense trackers among what :func:`candidates_of` takes, shown the reference motion."""
    with redirect_stdout(None):  # what there is to say of the files was said of their keyframes
        found = candidates_of(paths, trackers, device=device, dense=True, robot=robot, loaded=loaded)
    return {one: entrant for one, entrant in found.items() if entrant.tracks}


def _told_apart(found: dict[Candidate, Entrant]) -> dict[Candidate, Entrant]:
    """Return the candidates; what would share files of records with one before it is filed under a name of its own."""
    names: set[str] = set()
    stems: set[str] = set()
    apart = {}
    for one, entrant in found.items():
        if one.name in names:
            raise PlatError(
                f"two rows are called {one.name!r}: give each policy once, and rename one of two that differ"
            )
        if Cell(one, "").stem in stems:
            one = replace(one, filed=f"{one.name} {one.fingerprint[:8]}")
        names.add(one.name)
        stems.add(Cell(one, "").stem)
        apart[one] = entrant
    return apart


def _of_run(
    name: str, path: Path, device: str, dense: bool, interfaces: Sequence[Interface], policy: Policy
) -> dict[Candidate, Entrant]:
    folder = run_folder(path)
    run = SavedRun(folder)
    if run.unfinished:
        print(f"{name}: its training is not finished, the weights are those of its last checkpoint", flush=True)
    files = [folder / CONFIG_FILE, folder / WEIGHTS_FILE]
    history = made_by(run), _trained_on(run)
    told = interfaces if not dense and Entrant.of_policy(policy).tracks else _NO_INTERFACE
    found = {}
    for interface in told:
        label = f"{name}, {interface}" if len(told) > 1 else name
        load = partial(Entrant.of_run, path, device, dense, interface)
        one = _candidate(label, load, files, f"{dense} {interface}", *history)
        found[one] = Entrant.of_policy(policy, dense, interface)
    return found


def _trained_on(run: SavedRun) -> str:
    """Return the data sets that a run was trained on; of motions of no known one their file."""
    names = [(known.stem if (known := data_set_of(name)) else name) for name in trained_on(run)]
    return ", ".join(dict.fromkeys(names))


def _described(tracker: str) -> str:
    known = CATALOG[tracker]
    verified = "" if known.tested else "; unverified: its adapter was never run with the released weights"
    return f"{known.owner}, {known.version}{verified}"


def _once_loaded(loaded: Loaded, name: str, path: Path, load: Callable[[], Any]) -> Any:
    """Return what a path holds: it is loaded before it is fingerprinted, for that says what is wrong with it."""
    if (name, path) not in loaded:
        loaded[name, path] = load()
    return loaded[name, path]


def _candidate(
    name: str, load: "partial[Entrant]", files: Sequence[Path], shown: str, made_by: str = "", trained_on: str = ""
) -> Candidate:
    mark = fingerprint([*(file.read_bytes() for file in files), *imported_code(), shown.encode()])
    weights = max(files, key=lambda file: file.stat().st_size)
    return Candidate(name, load, mark, sha256(weights), made_by, trained_on)


def _bundle(path: Path, robot: str, dense: bool) -> Entrant:
    return Entrant.of_bundle(path, get_robot(robot), dense)


def _tracker(name: str, path: Path, dense: bool, interface: Interface) -> Entrant:
    return Entrant.of_tracker(CATALOG[name].load(path), dense, interface)


def _files(bundle: Path) -> list[Path]:
    return [bundle] if bundle.suffix == ".onnx" else sorted(file for file in bundle.iterdir() if file.is_file())
