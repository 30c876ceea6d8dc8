"""Data sets of motions by the names of their files, with their licenses."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import PurePath

__all__ = ["DATA_SETS", "DataSet", "data_set_of", "license_table", "strictest_license"]


@dataclass(frozen=True)
class DataSet:
    """Data set of motions.

    Args:
        prefix: of the names of its motion files, in lower case.
        name: of the data set.
        license: by name.
        strictness: of the license, 0 for free ones, then attribution, share alike, and 3 for non-commercial ones.
    """

    prefix: str
    name: str
    license: str
    strictness: int


DATA_SETS = (
    DataSet("generated", "motions that plat generates", "Apache-2.0", 0),
    DataSet("bandai", "Bandai-Namco Research Motion Dataset 1 and 2, retargeted to the G1", "CC BY-NC 4.0", 3),
    DataSet("asap", "ASAP", "MIT", 0),
    DataSet("pbhc", "PBHC", "CC BY-NC 4.0", 3),
    DataSet(
        "hard_free",
        "CMU (mocap.cs.cmu.edu, created with funding from NSF EIA-0196217), g1-moves (Experiential Technologies), "
        "samples",
        "CMU's terms, CC BY 4.0; Apache-2.0, MIT and BSD",
        1,
    ),
    DataSet("hard_sa", "HDM05 (Müller et al.)", "CC BY-SA 3.0", 2),
    DataSet("hard_nc", "Sony SIE, NVIDIA ASE", "CC BY-NC 4.0, non-commercial", 3),
)
"""What the shipped weights were trained on."""
_UNKNOWN = DataSet("", "not known to plat", "ask who made them", 4)


def data_set_of(motions: str) -> DataSet | None:
    """Return the data set that a motion file or ``generated:...`` is of; None for one that is not known.

    >>> data_set_of("motions/bandai_train.npz").license
    'CC BY-NC 4.0'
    >>> data_set_of("generated:train/wide@900").license
    'Apache-2.0'
    """
    name = _short(motions.replace("\\", "/")).lower()
    return next((each for each in DATA_SETS if name.startswith(each.prefix)), None)


def license_table(motions: Iterable[str]) -> str:
    """Return a Markdown table of motions, data sets and licenses."""
    lines = ["| motions | data set | license |", "|---|---|---|"]
    for given in motions:
        known = data_set_of(given) or _UNKNOWN
        lines.append(f"| `{_short(given)}` | {known.name} | {known.license} |")
    return "\n".join(lines)


def strictest_license(motions: Iterable[str]) -> str:
    """Return the license that allows least; of motions that are not known to plat it is not known either.

    >>> strictest_license(["asap_train.npz", "hard_sa_train.npz"])
    'CC BY-SA 3.0'
    """
    return max((data_set_of(given) or _UNKNOWN for given in motions), key=lambda known: known.strictness).license


def _short(motions: str) -> str:
    """Return the name of a motion file; of generated motions the whole, in which a slash parts no folders."""
    return motions if motions.startswith("generated:") else PurePath(motions).name
