"""Matplotlib without a window."""

from pathlib import Path
from typing import Any

from plat.errors import RenderingError
from plat.extras import importing
from plat.files import replace_file

__all__ = ["pyplot", "write_figure"]


def pyplot() -> Any:
    """Return Matplotlib's ``pyplot``, set to draw into files without a window.

    Raises:
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    with importing("figures", "figures need", RenderingError):
        import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot

    return matplotlib.pyplot


def write_figure(figure: Any, path: str | Path, **options: Any) -> None:
    """Write a figure, in the format of the file's ending; the file is replaced in one step or not at all.

    Args:
        figure: of Matplotlib.
        path: of the file.
        options: of ``savefig``.

    Raises:
        OSError: naming the file, when the disk does not take it.
    """
    replace_file(Path(path), lambda part: figure.savefig(part, **options))
