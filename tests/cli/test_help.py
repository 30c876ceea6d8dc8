import subprocess
import sys

import pytest

from plat.cli import COMMANDS, main
from tests.cli.settings import settings_of


@pytest.mark.parametrize("command", COMMANDS)
def test_every_setting_has_a_line_of_help(command):
    settings = settings_of(command)
    assert len(settings) >= 2
    bad = {name: text for name, text in settings if not text or "\n" in text or len(text) > 90}
    assert bad == {}


def test_the_table_of_commands(capsys):
    main(["--help"])
    out = capsys.readouterr().out
    for name, command in COMMANDS.items():
        assert f"  {name}" in out
        assert command.summary in out


def test_the_table_needs_no_torch():
    program = "import sys; from plat.cli import main; main(['--help']); sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True, stdout=subprocess.DEVNULL)


def test_an_unknown_command_is_one_line():
    with pytest.raises(SystemExit, match="'expret' is no command of plat, expected one of expert, .*distill") as error:
        main(["expret"])
    assert "\n" not in str(error.value)
