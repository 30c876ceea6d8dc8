"""Lineage of a run: which recipe made it, from which other runs, and what all of them were trained on."""

from contextlib import suppress
from pathlib import Path, PurePath
from typing import Any

from torch import nn

from plat.errors import PlatError
from plat.motions.generation import PREFIX
from plat.runs.inputs import saved_inputs, weights_print
from plat.runs.locate import is_run, shipped_runs
from plat.runs.saved_run import SavedRun

__all__ = ["made_by", "parents", "trained_on"]

_POLICIES = ("init", "expert", "student")
"""Settings that name the run of a policy."""

_FACTS = ("finished", "made_with")
"""What an average knows of each run."""

_KINDS = ("latent", "plain")
"""Values of the setting ``student`` of stage 2, where it is no run."""


def parents(run: SavedRun) -> list[SavedRun]:
    """Return the runs that a run began from, learned from or is the mean of, as far as they are here.

    They are looked for by their path, beside the run, and among the weights that come with plat. One whose weights are
    others than ``inputs.json`` knows, or that was trained on since it was averaged, is another run.
    """
    inputs: dict[str, Any] = {}
    with suppress(PlatError):  # an average has none, nor has a run of an older plat; a damaged one says nothing
        inputs = saved_inputs(run.folder)
    given = [(run.settings.get(name), {"weights": inputs.get(name)}) for name in _POLICIES]
    given += [(run.settings.get("init_model"), {})]
    given += [(part.get("run"), {name: part[name] for name in _FACTS if name in part}) for part in run.averaged]
    found: dict[Path, SavedRun] = {}
    shipped = shipped_runs()
    for name, known in ((str(each), known) for each, known in given if each and each not in _KINDS):
        beside = run.folder.resolve().parent / PurePath(name).name
        # a bare name is of a run beside it, unless weights tell
        places = [Path(name), beside] if PurePath(name).name != name or known.get("weights") else [beside]
        places += [shipped[name]] if name in shipped else []
        for folder in places:
            if is_run(folder) and folder.resolve() != run.folder.resolve() and _is_known(SavedRun(folder), **known):
                found.setdefault(folder.resolve(), SavedRun(folder))
                break
    return list(found.values())


def _is_known(run: SavedRun, weights: str | None = None, **facts: Any) -> bool:
    """Return whether a run has the weights of a fingerprint and the facts in its settings, as far as they are known."""
    if any(run.config.get(name) != fact for name, fact in facts.items()):
        return False
    if weights is None:
        return True
    try:
        policy = run.policy_as(nn.Module, "weights")
    except PlatError:
        return False
    # of one that was fine-tuned, its student is gone on from
    student = getattr(policy, "student", None)
    return weights in (weights_print(one) for one in (policy, student) if isinstance(one, nn.Module))


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
    if str(motions).startswith(PREFIX):
        return "generated"
    return name.removesuffix(PurePath(name).suffix).removesuffix("_train")
