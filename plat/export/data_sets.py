"""Data sets of motions with their licenses, as far as the names of files tell."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import PurePath

from plat.motions.generation import PREFIX
from plat.words import in_cell

__all__ = ["DATA_SETS", "DataSet", "data_set_of", "license_table", "licenses_told"]

_PARTS = frozenset({"train", "val", "fit", "g", "level", "third", "sixth"})
"""Words that follow the name of a data set in files of the shipped weights."""


@dataclass(frozen=True)
class DataSet:
    """Data set of motions.

    Args:
        stem: of its motion files, in lower case; ``_train`` and the like may follow.
        name: of the data set, with the credits that it asks for.
        license: by name.
        strictness: of the license, 0 for free ones, then attribution, share alike, and 3 for non-commercial ones.
    """

    stem: str
    name: str
    license: str
    strictness: int


DATA_SETS = (
    DataSet("bandai", "Bandai-Namco Research Motion Dataset 1 and 2, retargeted to the G1", "CC BY-NC 4.0", 3),
    DataSet("asap", "ASAP", "MIT", 0),
    DataSet("pbhc", "PBHC", "CC BY-NC 4.0", 3),
    DataSet(
        "hard_free",
        "CMU (mocap.cs.cmu.edu, created with funding from NSF EIA-0196217), g1-moves (Experiential Technologies, "
        "dance Jasmine Coro, karate Mike Gassaway), 100STYLE (Ian Mason, Sebastian Starke, Taku Komura), samples",
        "CMU's terms; CC BY 4.0 (g1-moves, 100STYLE); Apache-2.0, MIT and BSD (samples)",
        1,
    ),
    DataSet("hard_sa", "HDM05 (Müller et al.)", "CC BY-SA 3.0", 2),
    DataSet("hard_nc", "Sony SIE, NVIDIA ASE", "CC BY-NC 4.0, non-commercial", 3),
)
"""What the shipped weights were trained on, beside motions that plat generates."""
_OWN = DataSet("generated", "motions that plat generates", "Apache-2.0", 0)
_UNKNOWN = DataSet("", "unknown to plat", "unknown: ask who made them", 4)


def data_set_of(motions: str) -> DataSet | None:
    """Return the data set that a motion file or ``generated:...`` is of; None for one that is not known.

    Files are told by their names, which anyone may give: it is an assumption.

    >>> data_set_of("motions/bandai_train.npz").license
    'CC BY-NC 4.0'
    >>> data_set_of("generated:train/wide@900").license
    'Apache-2.0'
    >>> data_set_of("asap_by_me.npz")  # None
    """
    if motions.startswith(PREFIX):
        return _OWN
    stem = PurePath(_short(motions)).stem.lower()
    return next((each for each in DATA_SETS if _is_part(stem, each.stem)), None)


def license_table(motions: Iterable[str]) -> str:
    """Return a Markdown table of motions, data sets and licenses; it says which are assumed from a file's name."""
    lines = ["| motions | data set | license |", "|---|---|---|"]
    for given in motions:
        known = data_set_of(given) or _UNKNOWN
        assumed = ", by the file's name" if known in DATA_SETS else ""
        lines.append(f"| `{in_cell(_short(given))}` | {known.name}{assumed} | {known.license} |")
    return "\n".join(lines)


def licenses_told(motions: Iterable[str]) -> str:
    """Return in one or two sentences which license allows least, and whether some are not known.

    >>> licenses_told(["generated:train@60", "hard_sa_train.npz"])
    'The strictest of these licenses, if the names of the files are right: CC BY-SA 3.0.'
    """
    found = [data_set_of(given) or _UNKNOWN for given in motions]
    known = [each for each in found if each is not _UNKNOWN]
    if not known:
        return "Their licenses are unknown."
    others = "these licenses" if len(known) == len(found) else "the others"
    assumed = ", if the names of the files are right" if any(each in DATA_SETS for each in known) else ""
    told = f"The strictest of {others}{assumed}: {max(known, key=lambda each: each.strictness).license}."
    return told if len(known) == len(found) else f"The license of some of these motions is unknown. {told}"


def _is_part(stem: str, data_set: str) -> bool:
    return stem == data_set or (
        stem.startswith(f"{data_set}_") and _PARTS.issuperset(stem.removeprefix(f"{data_set}_").split("_"))
    )


def _short(motions: str) -> str:
    """Return the name of a motion file; of generated motions the whole, in which a slash parts no folders."""
    return motions if motions.startswith(PREFIX) else PurePath(motions.replace("\\", "/")).name
