import importlib
import subprocess
import sys

import pytest

from plat.cli import COMMANDS, main
from tests.cli.settings import settings_of


@pytest.mark.parametrize("command", COMMANDS)
def test_every_setting_has_a_line_of_help(command):
    settings = settings_of(command)
    assert settings
    bad = {name: text for name, text in settings if not text or "\n" in text or len(text) > 90}
    assert bad == {}


def test_the_table_of_commands(capsys):
    main(["--help"])
    out = capsys.readouterr().out
    for name, command in COMMANDS.items():
        assert f"  {name}" in out
        assert command.summary in out


# one process for all: what one help text imports, the next one would be blamed for
PROGRAM = """
import contextlib, io, sys
from plat.cli import main

for command in sys.argv[1:]:
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()) as out:
        main([*command.split(), "--help"])
    slow = {"torch", "tensordict", "torchrl", "mujoco", "matplotlib", "pydantic"} & set(sys.modules)
    if slow or "--help" not in out.getvalue():
        sys.exit(f"plat {command} --help imports {slow}, prints {out.getvalue()}")
"""


def test_help_needs_no_torch():
    commands = ["", *COMMANDS, "motions convert", "motions retarget", "keyframes show", "keyframes from-motion"]
    out = subprocess.run([sys.executable, "-c", PROGRAM, *commands], capture_output=True, text=True, check=False)
    assert out.returncode == 0, out.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["evalute"],
            "'evalute' is no command of plat, expected one of expert, .*curves, perhaps 'evaluate'; see plat --help",
        ),
        (
            ["keyframes", "shwo", "a.json"],
            "'shwo' is no command of plat keyframes, expected one of from-motion, show, around, convert, "
            "perhaps 'show'; see plat keyframes --help",
        ),
        (["motions", "bring", "--out", "x"], "'bring' is no command of plat motions, expected one of .*, map; see"),
        (["motions", "inspect", "--outt", "x"], "Unrecognized options: --outt, x; perhaps you meant --out; see"),
    ],
)
def test_an_unknown_command_is_one_line(words, message):
    with pytest.raises(SystemExit, match=f"^error: {message}") as error:
        main(words)
    assert "\n" not in str(error.value)


def test_ctrl_c_during_an_import_is_one_line(monkeypatch, capsys):
    def interrupted(name: str) -> None:
        try:
            try:
                raise KeyboardInterrupt
            except KeyboardInterrupt as error:
                raise ImportError("initialization failed") from error  # as extension modules do, one for another
        except ImportError as error:
            raise ImportError("initialization failed") from error

    monkeypatch.setattr("plat.cli.import_module", interrupted)
    with pytest.raises(SystemExit) as ended:
        main(["curves", "a"])
    assert (ended.value.code, capsys.readouterr().err) == (130, "stopped\n")
    monkeypatch.setattr("plat.cli.import_module", lambda name: importlib.import_module("plat.nothing"))
    with pytest.raises(ModuleNotFoundError, match=r"plat\.nothing"):
        main(["curves", "a"])


def test_help_has_no_backquotes_and_its_frame_is_straight(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    with pytest.raises(SystemExit):
        main(["expert", "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert not any("``" in line for line in lines)
    assert {len(line) for line in lines if "Delta_max, the longest command" in line} == {120}


def test_a_clone_without_links_is_told_so(tmp_path, monkeypatch):
    """Git makes a file that holds the target where there are no links, as on Windows."""
    (tmp_path / "cli").mkdir()
    (tmp_path / "recipes").write_text("../recipes")
    monkeypatch.setattr("plat.cli.__file__", str(tmp_path / "cli" / "__init__.py"))
    with pytest.raises(SystemExit, match=r"recipes' is a file, expected a link to a folder: .*core\.symlinks=true"):
        main(["imagine", "--help"])
