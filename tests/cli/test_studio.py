import signal
import socket
import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

import plat
from plat.cli import studio
from plat.errors import CheckpointError, KeyframeError, MotionError, StudioError
from plat.robots import G1

PLAT = Path(__file__).parents[2] / "plat" / "weights" / "plat"


def test_without_the_extra_there_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    for name in [name for name in sys.modules if name.startswith("plat.studio")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr(plat, "studio", raising=False)  # put back with the modules: other tests patch them by name
    with pytest.raises(StudioError, match=r"pip install 'plat-rl\[studio\]'"):
        studio.main(studio.StudioRecipe(runs=(PLAT,)))


@pytest.fixture
def _extra() -> None:
    for package in ("viser", "mjviser", "mink"):
        pytest.importorskip(package, reason="the extra plat-rl[studio] is not installed")


@pytest.mark.usefixtures("_extra")
def test_missing_files_are_named(tmp_path):
    with pytest.raises(CheckpointError, match="nowhere"):
        studio.main(studio.StudioRecipe(runs=(tmp_path / "nowhere",)))
    with pytest.raises(KeyframeError, match=r"wave\.json"):
        studio.main(studio.StudioRecipe(runs=(PLAT,), keyframes=tmp_path / "wave.json"))
    with pytest.raises(MotionError, match=r"nothing\.npz': no such file"):
        studio.main(studio.StudioRecipe(runs=(PLAT,), motions="generated:val nothing.npz"))


@pytest.mark.usefixtures("_extra")
def test_a_port_in_use_is_named():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(StudioError, match=f"port {port}"):
            studio.main(studio.StudioRecipe(runs=(PLAT,), port=port))


@pytest.mark.usefixtures("_extra")
def test_the_browser_is_opened_where_there_is_a_screen(monkeypatch, tmp_path):
    from plat.studio.app import Studio

    opened: list[str] = []
    called, closed = threading.Event(), threading.Event()

    def browse(address: str) -> None:
        opened.append(address)
        called.set()
        closed.wait(60)

    monkeypatch.setattr("webbrowser.open", browse)
    monkeypatch.setattr(Studio, "run", lambda self: called.wait(60))  # it runs while the browser is open
    monkeypatch.setattr(studio.sys, "platform", "linux")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    recipe = studio.StudioRecipe(runs=(PLAT,), port=port, folder=tmp_path)
    monkeypatch.setenv("DISPLAY", ":0")
    studio.main(recipe)
    assert not closed.is_set()
    closed.set()
    assert opened == [f"http://localhost:{port}/"]
    monkeypatch.delenv("DISPLAY")
    assert not studio._has_screen(), "a browser in the terminal would take it"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.mark.usefixtures("_extra")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_signal_ends_it_with_an_autosave(monkeypatch, tmp_path, name):
    from plat.studio.app import Studio
    from plat.studio.autosave import AUTOSAVE

    if not hasattr(signal, name):
        pytest.skip(f"this system has no {name}")
    number = getattr(signal, name)
    kept = signal.signal(number, signal.SIG_DFL)  # under nohup HUP is ignored, and is to be
    run, before = Studio.run, signal.getsignal(number)

    def edited_and_ended(self: Studio) -> None:
        self.session.add()
        for _ in range(2):
            signal.raise_signal(number)
        run(self)

    monkeypatch.setattr(Studio, "run", edited_and_ended)
    try:
        studio.main(studio.StudioRecipe(runs=(PLAT,), port=free_port(), folder=tmp_path, browser=False))
        assert (tmp_path / AUTOSAVE).exists()
        assert signal.getsignal(number) == before
    finally:
        signal.signal(number, kept)


def test_a_file_is_proposed_under_its_own_place_in_the_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert studio._in_folder(Path("sub/wave.json"), Path()) == str(Path("sub/wave.json"))
    assert studio._in_folder(tmp_path / "sub" / "wave.json", Path("sub")) == "wave.json"
    assert capsys.readouterr().out == ""
    assert studio._in_folder(Path("wave.json"), Path("sub")) == "wave.json"
    assert "the page saves a copy there, wave.json" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"keyframes": Path("wave.json")}, "--keyframes: without effect on the page of --static"),
        ({"browser": False}, "--no-browser: without effect on the page of --static"),
        ({"motions": "generated:test"}, "--motions: without effect on the page of --static"),
        ({"static": None, "libraries": Path("node_modules")}, "--libraries: takes effect only with --static"),
    ],
)
def test_options_that_a_page_of_files_cannot_honor_are_refused(tmp_path, options, message):
    recipe = studio.StudioRecipe(runs=(PLAT,), **{"static": tmp_path / "page", **options})
    with pytest.raises(StudioError, match=message):
        studio.main(recipe)
    assert not (tmp_path / "page").exists()


def test_runs_in_folders_of_the_same_name_are_told_apart():
    runs = Path("a/plat"), Path("b/plat"), Path("b/expert")
    assert studio._names(runs) == ["a/plat", "b/plat", "expert"]


def test_a_run_that_is_given_twice_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "link").symlink_to("a")
    studio.check_once((Path("a"), Path("b/a"), Path("plat-g1")))
    with pytest.raises(StudioError, match="^run 'a' is given twice: expected each run once$"):
        studio.check_once((Path("a"), Path("b"), Path("a")))
    for other in (tmp_path / "a", Path("link")):
        with pytest.raises(StudioError, match=f"^run '{other}' is given twice, also as 'a': expected each run once$"):
            studio.check_once((Path("a"), other))


@pytest.mark.parametrize("options", [{}, {"static": Path("page")}])
def test_policies_of_several_robots_are_opened_apart(tmp_path, monkeypatch, options):
    """The joints are the same, but each action of one would be a target from the other's default pose."""
    bent = replace(G1, name="bent", default_pose={**G1.default_pose, "left_elbow": 1.2})
    robots = {"a": G1, "b": replace(G1, name="alias"), "c": bent}
    monkeypatch.setattr(studio, "load_policy", lambda run: SimpleNamespace(robot=robots[run.name]))
    monkeypatch.chdir(tmp_path)
    recipe = studio.StudioRecipe(runs=tuple(map(Path, robots)), **options)
    with pytest.raises(StudioError, match="^run 'c' drives robot 'bent', and 'a' 'g1': open them separately$"):
        studio.main(recipe)
    studio.check_robots({}, {name: SimpleNamespace(robot=robots[name]) for name in "ab"})


def test_the_run_of_the_working_directory_has_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plat").mkdir()
    assert studio._names((Path(), Path("plat"))) == [tmp_path.name, "plat"]
    monkeypatch.chdir(tmp_path / "plat")
    assert studio._names((Path(), Path(), Path("a/plat"), Path(".."))) == [".", ".", "a/plat", tmp_path.name]
