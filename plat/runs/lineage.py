"""Lineage of a run: which recipe made it, from which other runs, and what all of them were trained on."""

from pathlib import Path, PurePath

from plat.errors import PlatError
from plat.runs.locate import is_run, shipped_runs
from plat.runs.saved_run import SavedRun

__all__ = ["made_by", "parents", "trained_on"]

_KINDS = ("latent", "plain")
"""Values of the setting ``student`` of stage 2, where it is no run."""


def parents(run: SavedRun) -> list[SavedRun]:
    """Return the runs that a run began from, learned from or is the mean of, as far as they are here.

    They are looked for beside it, by an absolute path, and among the weights that come with plat.
    """
    given = [run.settings.get(name) for name in ("init", "init_model", "expert", "student")]
    given += [part.get("run") for part in run.averaged]
    found: dict[Path, SavedRun] = {}
    shipped = shipped_runs()
    for name in (str(each) for each in given if each and each not in _KINDS):
        beside = run.folder.resolve().parent / PurePath(name).name
        places = [Path(name)] if PurePath(name).is_absolute() else []
        places += [beside, *([shipped[name]] if name in shipped else [])]
        folder = next((place for place in places if is_run(place) and place.resolve() != run.folder.resolve()), None)
        if folder is not None:
            found.setdefault(folder.resolve(), SavedRun(folder))
    return list(found.values())


def made_by(run: SavedRun) -> str:
    """Return the recipe of a run, its variant, of how many runs it is the mean, and the runs that it began from.

    >>> made_by(SavedRun("imagined-g1"))
    'plat imagine, plain, mean of 2 runs'
    """
    names = {folder.resolve(): name for name, folder in shipped_runs().items()}
    settings = run.settings
    variant = settings.get("variant") or (settings.get("student") if settings.get("student") in _KINDS else None)
    before = [names.get(parent.folder.resolve(), parent.name) for parent in parents(run)]
    mean = [f"mean of {len(run.averaged)} runs"] if len(run.averaged) > 1 else []
    words = [f"plat {run.recipe}" if run.recipe else "plat", *([str(variant)] if variant else []), *mean]
    return ", ".join([*words, *([f"from {' and '.join(before)}"] if before else [])])


def trained_on(run: SavedRun) -> list[str]:
    """Return the names of all motions that a run and those before it were trained on, without what they were cut to.

    Names lose the ending, and ``_train``; generated motion loses its seconds.

    >>> trained_on(SavedRun("plat-generated-g1"))
    ['generated']
    """
    seen: dict[str, None] = {}
    waiting, known = [run], {run.folder.resolve()}
    while waiting:
        each = waiting.pop(0)
        seen |= dict.fromkeys(map(_short, each.motions))
        task = each.settings.get("task")
        if isinstance(task, dict) and task.get("authored"):
            seen["authored keyframes"] = None
        try:
            further = [parent for parent in parents(each) if parent.folder.resolve() not in known]
        except PlatError:
            continue  # a damaged neighbor says nothing
        known |= {parent.folder.resolve() for parent in further}
        waiting += further
    return list(seen)


def _short(motions: str) -> str:
    """Return the name of a motion file, folder or generated motion."""
    name = PurePath(str(motions).replace("\\", "/")).name
    if str(motions).startswith("generated"):
        return "generated"
    return name.removesuffix(PurePath(name).suffix).removesuffix("_train")
