"""Style that all figures share: sizes, type, and one look for each policy."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plat.evaluation.score_table import Score
from plat.figures.pyplot import pyplot, write_figure

__all__ = ["COLUMN", "PAGE", "Look", "in_legend", "looks", "paper_style", "policies", "save_figure"]

COLUMN = 3.4
"""Width of a column (inches)."""
PAGE = 7.0
"""Width of both columns (inches)."""

_PAPER = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.linewidth": 0.4,
    "grid.alpha": 0.35,
    "legend.frameon": False,
    "pdf.fonttype": 42,  # letters stay letters, which publishers ask for
    "text.parse_math": False,  # names of policies and families are no formulas, whatever is in them
    "figure.constrained_layout.use": True,
}


@dataclass(frozen=True)
class Look:
    """Color, marker and line of a policy, the same in every figure."""

    color: str
    marker: str
    dashes: str = "-"
    width: float = 1.1


# The rows of the ablation, PLAT the strongest; colors are Okabe and Ito's, which the color-blind can tell apart.
_KNOWN = {
    "SONIC": Look("#000000", "P", ":"),
    "SONIC-style": Look("#000000", "X", "--"),
    "TWIST2": Look("#999999", "v", ":"),
    "wbc": Look("#666666", "^", "-."),
    "YAHMP": Look("#B39B00", "d", ":"),
    "Scratch RL": Look("#CC79A7", "<", "--"),
    "w/o privileged latent": Look("#56B4E9", "s"),
    "DAgger": Look("#0072B2", "D"),
    "Direct RL fine-tune": Look("#E69F00", ">", "--"),
    "Residual action": Look("#009E73", "h"),
    "PLAT": Look("#D55E00", "o", width=2.0),
    "Imagined": Look("#7B3294", "s", width=2.0),
    "Imagined latent": Look("#C2A5CF", "p", width=2.0),
}
# of weights that come with plat: the row that they are
_SHIPPED = {"expert": "Scratch RL", "plain": "w/o privileged latent", "imagined-latent": "Imagined latent"}
_COLORS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C510A")
_MARKERS = "osD^vp*"
# for others: a color each, then the same colors again with other markers and dashes
_OTHERS = [
    Look(color, _MARKERS[(number + turn) % len(_MARKERS)], dashes)
    for turn, dashes in enumerate(("-", "--", "-.", ":"))
    for number, color in enumerate(_COLORS)
]


def looks(names: Sequence[str]) -> dict[str, Look]:
    """Return a look for each policy: its own for a row of the ablation, in any case; others take what is left.

    A released tracker keeps its look with its interface in parentheses. Shipped weights have the look of their row,
    unless two of the names would share one.

    >>> looks(["DAgger", "mine", "wbc (line)"])["DAgger"].color
    '#0072B2'
    """
    rows = {name.lower(): look for name, look in _KNOWN.items()}
    of_row = {name: _row(name) for name in names}
    alone = [row for row, count in Counter(of_row.values()).items() if count == 1]
    known = {
        name: rows[row if row in alone else name.lower()]
        for name, row in of_row.items()
        if row in rows and (row in alone or name.lower() in rows)
    }
    drawn = dict(known)
    for name in names:
        if name not in known:
            colors, markers = (Counter(getattr(one, what) for one in drawn.values()) for what in ("color", "marker"))
            taken = {(one.color, one.marker) for one in drawn.values()}
            others = (look for look in _OTHERS if (look.color, look.marker) not in taken)
            # a color that few have, then a marker that few have
            drawn[name] = min(others, key=lambda look: (colors[look.color], markers[look.marker]), default=_OTHERS[0])
    return {name: drawn[name] for name in names}


def _row(name: str) -> str:
    row = name.partition(" (")[0].removesuffix("-g1")
    return _SHIPPED.get(row, row).lower()


def policies(scores: Sequence[Score]) -> list[str]:
    """Return the names of the policies, in the order of the scores."""
    return list(dict.fromkeys(score.policy for score in scores))


def in_legend(name: str) -> str:
    """Return a name as it stands in a legend: Matplotlib leaves out what begins with an underscore.

    >>> in_legend("_best"), in_legend("PLAT")
    (' _best', 'PLAT')
    """
    return f" {name}" if name.startswith("_") else name


@contextmanager
def paper_style() -> Iterator[Any]:
    """Provide Matplotlib's ``pyplot`` with the type and lines of a paper.

    Raises:
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    plt = pyplot()
    with plt.rc_context(_PAPER):
        yield plt


def save_figure(figure: Any, stem: Path) -> list[Path]:
    """Write ``STEM.pdf`` (vectors) and ``STEM.png`` (300 dots an inch), and close the figure."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    paths = [stem.with_name(f"{stem.name}.{kind}") for kind in ("pdf", "png")]
    with paper_style() as plt:
        for path in paths:
            # no date: the same scores give the same file
            metadata = {"CreationDate": None} if path.suffix == ".pdf" else None
            write_figure(figure, path, dpi=300, bbox_inches="tight", pad_inches=0.02, metadata=metadata)
        plt.close(figure)
    return paths
