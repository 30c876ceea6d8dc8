"""Candidates of a comparison, from what a command line names: runs, bundles and released trackers."""

from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from functools import partial
from pathlib import Path

from plat.baselines import CATALOG, ReleasedTrackers, identify
from plat.baselines.catalog import sha256
from plat.deploy.runner import BUNDLE_FILE
from plat.errors import PlatError
from plat.evaluation import Entrant, Interface
from plat.evaluation.cells import Candidate, Cell, fingerprint
from plat.export.data_sets import data_set_of
from plat.files import readable
from plat.robots import get_robot
from plat.runs.lineage import made_by, trained_on
from plat.runs.locate import CONFIG_FILE, run_folder
from plat.runs.saved_run import WEIGHTS_FILE, SavedRun
from plat.runs.user_modules import imported_code

__all__ = ["candidates_of", "trackers_of"]


def candidates_of(
    paths: Sequence[Path],
    trackers: ReleasedTrackers,
    *,
    device: str = "cpu",
    dense: bool = False,
    interfaces: Sequence[Interface] = ("next-frame",),
    robot: str = "g1",
) -> dict[Candidate, Entrant]:
    """Return every candidate with its policy, loaded. Dense trackers are there once for each interface.

    Args:
        paths: runs or names of shipped weights, bundles, and ``.onnx`` files of bundles or released trackers.
        trackers: further released trackers.
        device: of the policies.
        dense: show the reference motion in place of keyframes.
        interfaces: how dense trackers are told of a keyframe.
        robot: of bundles.

    Raises:
        PlatError: when something cannot be loaded, an ``.onnx`` file is of no tracker that plat knows, or two have one
            name.
    """
    released = {name: path for name, path in trackers.files().items() if path is not None}
    paths = [path if path.name.strip(".") else path.resolve() for path in paths]  # "." has no name
    names = [readable(path.name) for path in paths]
    found: dict[Candidate, Entrant] = {}
    for path in paths:
        tracker = identify(path) if path.suffix == ".onnx" and path.is_file() else None
        if tracker is not None:
            released[tracker.name] = path
            continue
        name = readable(path.name if names.count(readable(path.name)) == 1 else str(path))
        if path.suffix == ".onnx" or (path / BUNDLE_FILE).exists():
            shown = "bundle dense" if dense else "bundle"
            found |= _once(name, partial(_bundle, path, robot, dense), _files(path), shown, "plat, a bundle")
        else:
            found |= _of_run(name, path, device, dense, interfaces)
    for name, path in released.items():
        files = CATALOG[name].paths(path)
        for interface in interfaces if not dense else interfaces[:1]:
            label = name if CATALOG[name].tested else f"{name} (unverified)"
            label = label if len(interfaces) == 1 or dense else f"{label}, {interface}"
            load = partial(_tracker, name, path, dense, interface)
            found |= _once(label, load, files, f"{dense} {interface}", _described(name), "its owner's data")
    if not found:
        raise PlatError("nothing to evaluate: give run directories, or files of released trackers (--trackers.twist2)")
    return _told_apart(found)


def trackers_of(
    paths: Sequence[Path], trackers: ReleasedTrackers, *, device: str = "cpu", robot: str = "g1"
) -> dict[Candidate, Entrant]:
    """Return the dense trackers among what :func:`candidates_of` takes, shown the reference motion."""
    with redirect_stdout(None):  # what there is to say of the files was said of their keyframes
        found = candidates_of(paths, trackers, device=device, dense=True, robot=robot)
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
    name: str, path: Path, device: str, dense: bool, interfaces: Sequence[Interface]
) -> dict[Candidate, Entrant]:
    folder = run_folder(path)
    run = SavedRun(folder)
    if run.unfinished:
        print(f"{name}: its training is not finished, the weights are those of its last checkpoint", flush=True)
    files = [folder / CONFIG_FILE, folder / WEIGHTS_FILE]
    first = partial(Entrant.of_run, path, device, dense, interfaces[0])
    found = _once(name, first, files, f"{dense} {interfaces[0]}")
    history = made_by(run), _trained_on(run)
    found = {replace(one, made_by=history[0], trained_on=history[1]): entrant for one, entrant in found.items()}
    if len(interfaces) == 1 or dense or not next(iter(found.values())).tracks:
        return found
    found = {}
    for interface in interfaces:
        load = partial(Entrant.of_run, path, device, dense, interface)
        found |= _once(f"{name}, {interface}", load, files, f"{dense} {interface}", *history)
    return found


def _trained_on(run: SavedRun) -> str:
    """Return the data sets that a run was trained on; of motions of no known one their file."""
    names = [(known.prefix if (known := data_set_of(name)) else name) for name in trained_on(run)]
    return ", ".join(dict.fromkeys(names))


def _described(tracker: str) -> str:
    known = CATALOG[tracker]
    verified = "" if known.tested else "; unverified: its adapter was never run with the released weights"
    return f"{known.owner}, {known.version}{verified}"


def _once(
    name: str, load: "partial[Entrant]", files: Sequence[Path], shown: str, made_by: str = "", trained_on: str = ""
) -> dict[Candidate, Entrant]:
    entrant = load()  # first: it says what is wrong with the files
    mark = fingerprint([*(file.read_bytes() for file in files), *imported_code(), shown.encode()])
    weights = max(files, key=lambda file: file.stat().st_size)
    return {Candidate(name, load, mark, sha256(weights), made_by, trained_on): entrant}


def _bundle(path: Path, robot: str, dense: bool) -> Entrant:
    return Entrant.of_bundle(path, get_robot(robot), dense)


def _tracker(name: str, path: Path, dense: bool, interface: Interface) -> Entrant:
    return Entrant.of_tracker(CATALOG[name].load(path), dense, interface)


def _files(bundle: Path) -> list[Path]:
    return [bundle] if bundle.suffix == ".onnx" else sorted(file for file in bundle.iterdir() if file.is_file())
