import contextlib
import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from plat.streams import CLOSED_PIPE, ReaderLeft, standard_streams

FULL = Path("/dev/full")
full = pytest.mark.skipif(not FULL.exists(), reason="no device that is always full")
PLAT = [sys.executable, "-m", "plat"]
RECIPE = [sys.executable, "-m", "plat.recipes.imagine"]
# prints before and after work, and swallows errors of files as code that writes files does
WORK = """
import sys
from pathlib import Path
from plat.streams import standard_streams

with standard_streams():
    try:
        for _ in range(20):
            print("line " * 1000)
    except OSError:
        pass
    Path("done").touch()
    print("stderr", file=sys.stderr)
    sys.exit(int(sys.argv[1]) if sys.argv[1:] else None)
"""


def _run(command, **options):
    return subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False, **options)


def _left_pipe():
    reading, writing = os.pipe()
    os.close(reading)
    return writing


@pytest.mark.parametrize("command", [[*PLAT, "--help"], [*PLAT, "imagine", "--help"], [*RECIPE, "--help"]])
def test_a_reader_that_left_ends_a_command_quietly(command):
    pipe = _left_pipe()
    done = _run(command, stdout=pipe)
    os.close(pipe)
    assert (done.returncode, done.stderr) == (CLOSED_PIPE, "")


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_left_ends_work_at_once(tmp_path, unbuffered):
    pipe = _left_pipe()
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    done = _run([sys.executable, "-c", WORK], stdout=pipe, cwd=tmp_path, env=_importable(environment))
    os.close(pipe)
    assert (done.returncode, done.stderr) == (CLOSED_PIPE, "")
    assert not (tmp_path / "done").exists()


@full
@pytest.mark.parametrize("status", [0, 3])
def test_a_full_disk_is_said_after_the_work(tmp_path, status):
    with FULL.open("w") as disk:
        done = _run([sys.executable, "-c", WORK, str(status)], stdout=disk, cwd=tmp_path, env=_importable(os.environ))
    assert (tmp_path / "done").exists()
    assert done.returncode == (status or 1)
    assert ("error: standard output: No space left on device" in done.stderr) == (status == 0)
    assert "Traceback" not in done.stderr


@full
@pytest.mark.parametrize("command", [[*PLAT, "imagine", "--help"], [*RECIPE, "--help"]])
def test_a_help_text_on_a_full_disk_is_one_line(command):
    with FULL.open("w") as disk:
        done = _run(command, stdout=disk)
    assert (done.returncode, done.stderr) == (1, "error: standard output: No space left on device\n")


@full
def test_a_full_disk_of_standard_error_changes_nothing(tmp_path):
    with FULL.open("w") as disk:
        done = subprocess.run(
            [sys.executable, "-c", WORK], stdout=subprocess.PIPE, stderr=disk, cwd=tmp_path, env=_importable(os.environ)
        )
    assert done.returncode == 0
    assert done.stdout.count(b"line") == 20_000


def test_closed_streams_show_nothing(tmp_path):
    done = subprocess.run(
        f"{sys.executable} -c {_quoted(WORK)} <&- >&- 2>&-", shell=True, cwd=tmp_path, env=_importable(os.environ)
    )
    assert done.returncode == 0
    assert (tmp_path / "done").exists()


@pytest.mark.skipif(os.name != "posix", reason="consoles are others")
def test_a_terminal_that_is_closed_does_not_end_the_work(tmp_path):
    """As of a job that was disowned: no signal comes, and writing is an error."""
    import pty

    ours, theirs = pty.openpty()
    program = """
import sys, time
from pathlib import Path
from plat.streams import standard_streams

with standard_streams():
    Path("begun").touch()
    while not Path("closed").exists():
        time.sleep(0.01)
    print("stdout", flush=True)
    print("stderr", file=sys.stderr, flush=True)
    Path("done").touch()
"""
    child = subprocess.Popen(
        [sys.executable, "-c", program], stdout=theirs, stderr=theirs, cwd=tmp_path, env=_importable(os.environ)
    )
    os.close(theirs)
    deadline = time.monotonic() + 60
    while not (tmp_path / "begun").exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.close(ours)
    (tmp_path / "closed").touch()
    assert child.wait(60) == 1
    assert (tmp_path / "done").exists()


@pytest.mark.skipif(os.name != "posix", reason="consoles are others")
def test_a_terminal_is_one_to_what_writes_into_it(tmp_path):
    import pty

    ours, theirs = pty.openpty()
    show = "print(sys.stdout.isatty(), sys.stderr.isatty(), sys.stdout.encoding, '\\udcff')"
    program = f"import sys\nfrom plat.streams import standard_streams\nwith standard_streams(): {show}"
    environment = _importable(os.environ)
    subprocess.run([sys.executable, "-c", program], stdout=theirs, stderr=theirs, env=environment, check=True)
    os.close(theirs)
    assert os.read(ours, 100) == b"True True utf-8 ?\r\n"
    os.close(ours)


def test_characters_that_the_screen_lacks():
    program = "from plat.streams import standard_streams\nwith standard_streams(): print('✓ a \\udcff')"
    for encoding, shown in (("ascii", b"? a ?"), ("iso-8859-1", b"? a ?"), ("utf-8", "✓ a ?".encode())):
        environment = _importable({**os.environ, "PYTHONIOENCODING": encoding})
        out = subprocess.run([sys.executable, "-c", program], capture_output=True, env=environment, check=True).stdout
        assert out.strip() == shown


def test_a_current_folder_that_was_deleted(tmp_path):
    folder = tmp_path / "gone"
    folder.mkdir()
    command = f"rmdir {folder}; {sys.executable} -m plat keyframes show x.json"
    done = _run(command, shell=True, cwd=folder, stdout=subprocess.PIPE, env=_importable(os.environ))
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == "error: the current folder does not exist any more: go to another one"
    assert "Traceback" not in done.stderr


def test_ctrl_c_while_a_command_is_imported_is_one_line():
    program = (
        "import plat.cli, signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a shell's background jobs begin without
        "plat.cli._usage = lambda: signal.raise_signal(signal.SIGINT)\n"
        "plat.cli.main(['--help'])"
    )
    done = _run([sys.executable, "-c", program], env=_importable(os.environ), stdout=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (128 + signal.SIGINT, "stopped\n")


def test_streams_in_the_place_of_the_programs_own_are_left_alone():
    with contextlib.redirect_stdout(io.StringIO()) as out, standard_streams():
        assert sys.stdout is out
        print("shown")
    assert out.getvalue() == "shown\n"


def test_the_end_of_a_reader_is_no_error_of_files():
    assert not issubclass(ReaderLeft, Exception)
    assert ReaderLeft().code == CLOSED_PIPE


def _importable(environment):
    return {**environment, "PYTHONPATH": str(Path(__file__).parents[1])}


def _quoted(program):
    return "'" + program.replace("'", "'\"'\"'") + "'"
