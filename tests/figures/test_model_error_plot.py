import pytest
import torch

from plat.evaluation.model_error import ModelErrors
from plat.figures import save_figure
from plat.figures.model_error_plot import model_error_plot


def test_lines_are_the_errors(tmp_path):
    pytest.importorskip("matplotlib")
    errors = ModelErrors(*(torch.linspace(0, number, 48) for number in range(1, 7)))
    figure = model_error_plot(errors)
    drawn = [[line.get_ydata()[-1] for line in axis.get_lines()] for axis in figure.axes]
    assert drawn == [[4.0, 1.0], [5.0, 2.0], [6.0, 3.0]]
    assert figure.axes[0].get_lines()[0].get_xdata()[-1] == pytest.approx(0.96)
    assert all(path.stat().st_size > 1000 for path in save_figure(figure, tmp_path / "errors"))
