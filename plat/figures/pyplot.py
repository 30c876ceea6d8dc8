"""Matplotlib without a window."""

from typing import Any

from plat.errors import RenderingError

__all__ = ["pyplot"]


def pyplot() -> Any:
    """Return Matplotlib's ``pyplot``, set to draw into files without a window.

    Raises:
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise RenderingError("figures need: pip install 'plat-rl[figures]'") from error
    matplotlib.use("Agg")
    import matplotlib.pyplot

    return matplotlib.pyplot
