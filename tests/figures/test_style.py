import pytest

from plat.evaluation import Estimate
from plat.evaluation.groups import score_groups
from plat.evaluation.study import CurvePoint
from plat.figures import group_plot, horizon_plot, radar_plot, robustness_plot, save_figure, success_plot
from plat.figures.style import looks, paper_style, policies
from tests.figures.scores import made_up, records

ROWS = ["SONIC", "SONIC-style", "TWIST2", "wbc", "Scratch RL", "w/o privileged latent", "DAgger"]
ROWS += ["Direct RL fine-tune", "Residual action", "PLAT"]


def test_a_row_looks_the_same_in_whatever_company():
    assert looks(ROWS)["PLAT"] == looks(["PLAT"])["PLAT"] == looks(["mine", "PLAT"])["PLAT"]
    assert looks(["dagger", "plat"])["plat"] == looks(["PLAT"])["PLAT"]  # a run's folder


def test_shipped_weights_and_trackers_with_an_interface_have_the_look_of_their_row():
    names = ["plat-g1", "expert-g1 (line)", "wbc (cascade)", "SONIC (unverified, line)"]
    assert list(looks(names).values()) == [looks([row])[row] for row in ("PLAT", "Scratch RL", "wbc", "SONIC")]
    # two that would look alike do not
    alike = looks(["wbc", "wbc (line)", "wbc (cascade)"])
    assert len({(look.color, look.marker) for look in alike.values()}) == 3


def test_no_two_policies_look_alike():
    others = [f"run {number}" for number in range(8)]
    for names in (ROWS, others, ROWS[6:] + others):
        assert len({(look.color, look.marker) for look in looks(names).values()}) == len(names)
    # a few runs differ in color already
    assert len({look.color for look in looks(others[:5]).values()}) == 5


def test_rows_of_a_benchmark_differ_in_color():
    """Lines have no markers in every figure."""
    names = ["imagined-g1", "plat-g1", "dagger-g1", "expert-g1 (line)", "TWIST2 (line)", "wbc (line)", "YAHMP (line)"]
    names += ["plat-model-g1", "dagger-model-g1", "plain-model-g1", "expert-model-g1 (cascade)"]
    assert len({look.color for look in looks(names).values()}) >= len(names) - 1
    assert len({(look.color, look.dashes) for look in looks(names).values()}) == len(names)


def test_policies_keep_their_order():
    assert policies(made_up("b", "a")) == ["b", "a"]


def test_a_figure_is_written_twice_and_is_the_same_every_time(tmp_path):
    pytest.importorskip("matplotlib")
    contents = []
    for name in ("one", "two"):
        with paper_style() as plt:
            figure, panel = plt.subplots()
            panel.plot([0, 1])
        written = save_figure(figure, tmp_path / "new" / f"{name}.v2")
        assert [path.name for path in written] == [f"{name}.v2.pdf", f"{name}.v2.png"]
        contents.append([path.read_bytes() for path in written])
    assert contents[0][0].startswith(b"%PDF")
    assert contents[0][1].startswith(b"\x89PNG")
    assert contents[0] == contents[1]


def test_the_style_ends_with_the_figure():
    pytest.importorskip("matplotlib")
    with paper_style() as plt:
        inside = plt.rcParams["font.size"]
    assert inside == 8
    assert plt.rcParams["font.size"] != 8


@pytest.mark.parametrize("name", ["_best", "a$b$c", "cost $5^$"])
def test_a_name_of_any_letters_stands_in_the_legend(tmp_path, name):
    scores = made_up(name, "PLAT")
    groups = score_groups(name, "mixed", [records(0.25, 0.1, 0.2)], ["a"] * 40, resamples=10)
    curve = [CurvePoint(name, "push", strength, Estimate(90.0, 80.0, 95.0)) for strength in (0.0, 0.5)]
    figures = {
        "radar": radar_plot(scores),
        "success": success_plot(scores, ["long"]),
        "horizon": horizon_plot(scores),
        "groups": group_plot(groups),
        "robustness": robustness_plot(curve),
    }
    for kind, figure in figures.items():
        save_figure(figure, tmp_path / kind)
        legends = [*figure.legends, *filter(None, (panel.get_legend() for panel in figure.axes))]
        texts = [text for legend in legends for text in legend.get_texts()]
        assert any(text.get_text().strip().startswith(name) for text in texts), kind
        assert not any(text.get_parse_math() for text in texts), kind
