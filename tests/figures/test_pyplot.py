import sys

import pytest

from plat.figures import pyplot
from plat.rendering import RenderingError


def test_figures_are_drawn_into_files(tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    figure, panel = pyplot().subplots()
    panel.plot([0, 1])
    figure.savefig(tmp_path / "line.png")
    pyplot().close(figure)
    assert matplotlib.get_backend().lower() == "agg"
    assert (tmp_path / "line.png").read_bytes().startswith(b"\x89PNG")


def test_without_the_extra_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(RenderingError, match=r"pip install 'plat-rl\[figures\]'"):
        pyplot()
