"""Pose keyframes in the browser, and watch policies chase them.

plat studio plat-g1 dagger-g1 expert-g1 --motions generated:val
"""

import os
import shlex
import signal
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import torch

import plat.headless  # noqa: F401

# isort: split

from plat.cli.options import StudioRecipe
from plat.errors import StudioError
from plat.extras import importing
from plat.files import expand_home
from plat.motions.files import motion_paths
from plat.motions.generation import PREFIX
from plat.robots import Robot, get_robot
from plat.runs import Policy, load_policy, same_robot
from plat.runs.interrupts import ENDING
from plat.runs.policies import deployed
from plat.runs.user_modules import import_modules


def main(recipe: StudioRecipe) -> None:
    """Run the recipe until it is interrupted."""
    check_together(recipe)
    with importing("studio", "the studio needs", StudioError):
        from plat.studio.app import Studio
        from plat.studio.session import Session
    # networks for one robot are so small that more threads only get in each other's way
    torch.set_num_threads(1)
    import_modules(recipe.imports)
    get_robot(recipe.robot)  # a description file makes the policies' robot known
    if named := [name for name in recipe.motions.split() if not name.startswith(PREFIX)]:
        motion_paths(named)  # they are read when the page asks for them
    check_once(recipe.runs)
    runs = dict(zip(_names(recipe.runs), recipe.runs, strict=True))
    policies = {name: load_policy(run) for name, run in runs.items()}
    robot = next(iter(policies.values())).robot
    check_robots(runs, policies)
    if recipe.static is not None:
        _write_static(recipe, runs, policies, robot)
        return
    session = Session(robot, {name: deployed(policy) for name, policy in policies.items()})
    if recipe.keyframes is None:
        session.begin_with("wave")
    else:
        session.open(recipe.keyframes)
    path = "keyframes.json" if recipe.keyframes is None else _in_folder(recipe.keyframes, recipe.folder)
    studio = Studio(
        session, host=recipe.host, port=recipe.port, motions=recipe.motions, path=path, folder=recipe.folder
    )
    print(f"keyframe studio: {studio.access.url} (Ctrl-C ends it)", flush=True)
    if recipe.browser and _has_screen():
        # some browsers return only when they are closed
        threading.Thread(target=webbrowser.open, args=(studio.access.url,), daemon=True).start()
    with _ended_by_signals(studio.end):
        try:
            studio.run()
        except KeyboardInterrupt:
            pass
        finally:
            studio.stop()


def check_together(recipe: StudioRecipe) -> None:
    """Raise an error for options that would be without effect.

    Raises:
        StudioError: naming the option.
    """
    if recipe.static is None:
        if recipe.libraries is not None:
            raise StudioError("--libraries: takes effect only with --static")
        return
    for name in ("motions", "keyframes", "folder", "host", "port", "browser"):
        if getattr(recipe, name) != getattr(StudioRecipe, name):
            flag = "--no-browser" if name == "browser" else f"--{name}"
            raise StudioError(
                f"{flag}: without effect on the page of --static, where keyframe files are opened in the browser; "
                "expected none beside it"
            )


def check_once(runs: tuple[Path, ...]) -> None:
    """Raise an error for a run that is given twice: the page would have it once.

    Raises:
        StudioError: naming the run.
    """
    known: dict[str, Path] = {}
    for run in runs:
        other = known.setdefault(os.path.realpath(expand_home(run)), run)
        if other is not run:
            also = "" if str(other) == str(run) else f", also as {str(other)!r}"
            raise StudioError(f"run {str(run)!r} is given twice{also}: expected each run once")


def check_robots(runs: Mapping[str, Path], policies: Mapping[str, Policy]) -> None:
    """Raise an error for policies of several robots: for another one than theirs their actions mean other targets.

    Args:
        runs: run directories by name.
        policies: by the same names.

    Raises:
        StudioError: naming the run.
    """
    (first, one), *others = policies.items()
    for name, policy in others:
        if not same_robot(policy.robot, one.robot):
            raise StudioError(
                f"run {str(runs[name])!r} drives robot {policy.robot.name!r}, and {str(runs[first])!r} "
                f"{one.robot.name!r}: open them separately"
            )


def _write_static(recipe: StudioRecipe, runs: dict[str, Path], policies: dict[str, Policy], robot: Robot) -> None:
    from plat.modules import Expert
    from plat.studio.policy_playback import common_timing
    from plat.studio.static import write_static

    assert recipe.static is not None
    experts = [name for name, policy in policies.items() if isinstance(policy, Expert)]
    kept = {name: run for name, run in runs.items() if name not in experts}
    if not kept:
        raise StudioError("--static: none of the runs chases keyframes, expected runs of plat distill or plat refine")
    timing = common_timing({name: deployed(policies[name]) for name in kept})
    write_static(recipe.static, robot, kept, timing, recipe.libraries)
    left = f" (without {', '.join(experts)}: experts follow dense motion)" if experts else ""
    print(f"wrote {recipe.static} with {', '.join(kept)}{left}; any web server of files shows it:")
    print(f"  python -m http.server --directory {shlex.quote(str(recipe.static))}")


def _in_folder(file: Path, folder: Path) -> str:
    """Return what to call a file in the studio's folder, and say so where it will be a copy."""
    path, root = expand_home(file).resolve(), expand_home(folder).resolve()
    if path.is_relative_to(root):
        return str(path.relative_to(root))
    print(f"{file} is outside the folder {root}: the page saves a copy there, {path.name}", flush=True)
    return path.name


@contextmanager
def _ended_by_signals(end: Callable[[], None]) -> Iterator[None]:
    """Call a function at the signals TERM and HUP, which would end the process with unsaved keyframes.

    HUP comes when a terminal is closed, often twice, and is left to ``nohup`` where that ignores it.
    """
    ours = threading.current_thread() is threading.main_thread()
    caught = [number for number in ENDING if ours and signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, lambda *_: end()) for number in caught}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _has_screen() -> bool:
    # elsewhere a browser that works in a terminal would take the terminal
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _names(runs: tuple[Path, ...]) -> list[str]:
    """What to call each run: its folder, or its path where two folders have the same name."""
    folders = [os.path.basename(os.path.abspath(run)) for run in runs]  # that of . is the one that it is
    return [folder if folders.count(folder) == 1 else str(run) for folder, run in zip(folders, runs, strict=True)]
