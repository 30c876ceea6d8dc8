"""Page of a benchmark, from the files that it wrote: ``python -m plat.cli.benchmark_page OUT docs`` renews the docs.

It writes ``docs/results.md``, and copies tables and pictures to ``docs/benchmark``.
"""

import os
import re
import shlex
import shutil
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, get_args

from plat.errors import OutputError, PlatError, RecordsError
from plat.evaluation.groups import group_table
from plat.evaluation.names import RuleName
from plat.evaluation.score_table import difference_table, metrics_table, overview, table
from plat.evaluation.study import Study, clip_table, group_metrics
from plat.evaluation.study_files import read_study
from plat.files import copy_file, replace_file
from plat.json_file import read_json, short
from plat.runs.recipe import report_errors
from plat.words import counted

__all__ = ["ABOUT", "FIGURES", "group_figure", "page", "publish"]

ABOUT = "about.json"
"""File of what it takes to repeat the tables."""

_OPENING = """\
# Results

*Written by `plat benchmark` and `python -m plat.cli.benchmark_page`, from the files in `benchmark`.
[Evaluation](evaluation.md) says what is measured; [the notes](notes/2026.md) how the weights came
about.*
"""
_UNSAID = "not said in its file"
_READING = """\
Rows that were trained on other motions differ by that as well as by their method: compare those of
one list. Intervals are 95 %, bootstrapped over motions; where all samples of them are alike, as of
a group of one motion, there is none. Over few motions, which may be cut into many clips, [they are
too narrow](evaluation.md#the-ablation). Every row is given the same commands. A dense tracker is
shown its keyframe by the [interface](evaluation.md#released-trackers) in parentheses: the best one
by TKS@3 at Mixed, or at the first horizon where that is not among them. Calm and everyday motion
saturates TKS@3: rows differ on brisk and hard motion, and in their errors.
"""
_ALT = {
    "radar": "TKS@3, MPJPE@3 and MPKPE@3 over the horizons",
    "success": "Fraction of keyframes reached within a distance",
    "horizon": "Success and position error against the time of a command",
    "differences": "Paired differences to the other rows",
    "by_difficulty": "TKS@3 by difficulty",
    "by_family": "TKS@3 by family",
    **{f"by_family_{rule}": f"Whole-clip success by family, rule {rule}" for rule in get_args(RuleName)},
    "by_authored": "Authored keyframes that were reached, by family",
    "robustness": "TKS@3 against the strength of disturbances",
}
FIGURES = tuple(f"{stem}.{kind}" for stem in _ALT for kind in ("pdf", "png"))
"""Names of all figures that a set of motions may have."""


def page(folder: Path, pictures: str = "", sets: Collection[str] | None = None) -> str:
    """Return the page of a benchmark's output folder in Markdown.

    Args:
        folder: with the files of :func:`plat.evaluation.study_files.write_study`, a folder per set of motions.
        pictures: what the paths of pictures begin with.
        sets: names of the sets of motions that are shown; None for all that are there.

    Raises:
        RecordsError: when the folder holds no benchmark.
    """
    about, head, names = _read_about(folder)
    return _page(folder, about, head, [name for name in names if sets is None or name in sets], pictures)


def _page(folder: Path, about: dict[str, Any], head: str, names: Sequence[str], pictures: str) -> str:
    if not pictures:
        head = _outside_the_docs(head)
    sections = [_section(name, read_study(folder / name), folder / name, pictures + name, about) for name in names]
    return "\n".join([head, *sections])


def _outside_the_docs(head: str) -> str:
    """Return the head of a page that lies beside its files, where the other pages of the docs are not."""
    named = re.sub(r"\[([^]]+)\]\((\w[\w/]*\.md)[^)]*\)", r"\1 (plat's docs/\2)", head)
    return named.replace("from the files in `benchmark`", "from the files beside it")


def group_figure(kind: str) -> str:
    """Return the name, without ending, of the figure of groups: families, difficulty, or families by a success rule.

    >>> group_figure("family, supermimic")
    'by_family_supermimic'
    """
    return "by_" + kind.replace(", ", "_")


def publish(folder: Path, docs: Path) -> None:
    """Write ``results.md`` of a documentation folder, with the tables and pictures that it is made of.

    Raises:
        RecordsError: when ``folder`` holds no benchmark.
        OutputError: when the folder of the copies is, holds, or is in the one that they are made of, or is no copy.
    """
    kept = (docs / "benchmark").resolve()
    about, head, names = _read_about(folder)
    source = folder.resolve()
    if kept == source or kept in source.parents or source in kept.parents:
        told = f"{str(kept)!r}: would replace {str(folder)!r}, which it is a copy of"
        raise OutputError(f"{told}: give the folder that plat benchmark wrote, outside the docs")
    if kept.exists() and not (kept / ABOUT).is_file():
        raise OutputError(f"{str(kept)!r}: no earlier copy of a benchmark, as it has no {ABOUT}: move it elsewhere")
    text = _page(folder, about, head, names, "benchmark/")
    shown = [folder / name for name in names]  # other sets are of an earlier start
    # whole before it takes the place of the earlier one, which is there until then
    new, old = (kept.with_name(f".{kept.name}-{os.getpid()}.{word}") for word in ("new", "old"))
    try:
        paths = [path for one in shown for kind in ("csv", "png") for path in one.glob(f"*.{kind}")]
        for path in [folder / ABOUT, *paths]:
            copy_file(path, new / path.relative_to(folder), "a copy")
        if kept.exists():
            kept.rename(old)
        new.rename(kept)
    finally:
        shutil.rmtree(new, ignore_errors=True)
    shutil.rmtree(old, ignore_errors=True)
    replace_file(docs / "results.md", lambda part: part.write_text(text, encoding="utf-8"))


def _read_about(folder: Path) -> tuple[dict[str, Any], str, list[str]]:
    """Return what a benchmark says of itself, the head of its page, and the names of the sets that have scores."""
    try:
        about = read_json(
            folder / ABOUT, RecordsError, f"{str(folder)!r}: not the folder of a benchmark", constants=True
        )
        head, names = _head(about), [str(name) for name, *_ in about["sets"]]
    except (ArithmeticError, KeyError, TypeError, ValueError) as error:
        if isinstance(error, PlatError):
            raise
        raise RecordsError(f"{str(folder)!r}: not the folder of a benchmark ({ABOUT}: {short(error)})") from None
    return about, head, [name for name in names if (folder / name / "scores.csv").exists()]


def _head(about: dict[str, Any]) -> str:
    sets = [["set", "motions", "clips", "seconds", "fingerprint"]]
    for name, source, clips, seconds, mark in about["sets"]:
        sets.append([name, source, str(clips), str(seconds), f"`{mark}`"])
    rows = [["row", "made by", "trained on", "SHA-256 of the weights"]]
    rows += [[name, made_by, data or _UNSAID, f"`{mark}`"] for name, mark, made_by, data in about["rows"]]
    facts = [
        f"- {', '.join(about['versions'])}",
        f"- seed of the commands: {about['seed']}",
        *([f"- {about['window']}"] if "window" in about else []),
        f"- clips of more than {about['longest']:g} s are cut into equal pieces",
        *(f"- success rule `{rule}` of whole clips: {says}" for rule, says in about["rules"]),
    ]
    facts = [fill(fact, 100, subsequent_indent="  ", break_on_hyphens=False) for fact in facts]
    command = shlex.join(about["command"])
    parts = [_OPENING, f"```sh\n{command}\n```\n", "\n".join(facts) + "\n", table(sets) + "\n", table(rows) + "\n"]
    return "\n".join([*parts, _READING])


def _section(name: str, study: Study, folder: Path, pictures: str, about: dict[str, Any]) -> str:
    def shown(*stems: str) -> list[str]:
        found = [stem for stem in stems if (folder / f"{stem}.png").exists()]
        return [f"![{_ALT[stem]}]({pictures}/{stem}.png)\n" for stem in found]

    parts = [f"## {name}\n", overview(study.scores) + "\n", *shown("radar", "success", "horizon")]
    main = study.main_horizon
    columns = [score for score in study.scores if score.horizon == main]
    parts += [f"### {name}: all metrics at {main.capitalize()}\n", metrics_table(columns) + "\n"]
    if study.differences:
        ours = study.differences[0].ours
        parts += [
            f"### {name}: paired differences\n",
            f"On the same commands. **Bold**: {ours} is ahead beyond chance. *Italic*: it is behind.\n",
            difference_table(study.differences),
            *shown("differences"),
        ]
    if study.clips:
        parts += [f"### {name}: whole clips\n", clip_table(study.clips)]
    if study.dense:
        told = f"Dense trackers that see the motion itself, at {main.capitalize()} and on whole clips.\n"
        parts += [f"### {name}: with the dense reference\n", told, overview(study.dense) + "\n"]
        parts.append(clip_table(study.dense_clips))
    for kind, groups in study.groups.items():
        parts.append(f"### {name}: by {kind}\n" if kind != "authored" else f"### {name}: authored keyframes\n")
        parts += [group_table(groups, metric) for metric in group_metrics(groups)]
        parts += shown(group_figure(kind))
    if study.curves:
        told = f"TKS@3 (%) at {main.capitalize()}, on {counted(about['robustness_clips'], 'clip')} at most.\n"
        parts += [f"### {name}: robustness\n", told, *shown("robustness")]
        parts += [study.curve_table(one) for one in dict.fromkeys(point.disturbance for point in study.curves)]
    if study.interfaces:
        told = f"Dense trackers at {main.capitalize()}, by how they are shown their keyframe.\n"
        parts += [f"### {name}: interfaces\n", told, overview(study.interfaces) + "\n"]
    return "\n".join(parts)


def main(words: list[str]) -> None:
    """Run :func:`publish` on what a command line gives."""
    if len(words) != 2:
        sys.exit("error: expected two folders: that of a benchmark and that of the docs")
    with report_errors():
        publish(Path(words[0]), Path(words[1]))


if __name__ == "__main__":
    main(sys.argv[1:])
