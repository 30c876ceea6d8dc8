"""A command line run in this process, which spares the seconds that another one takes for its imports."""

import io
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass

from plat.cli import main


@dataclass(frozen=True)
class Ended:
    """What a shell would see of the command."""

    returncode: int
    stdout: str
    stderr: str


def run(*words: object) -> str:
    """Run ``plat`` with these words; return what it printed. It exits as the command does."""
    with redirect_stdout(io.StringIO()) as out:
        main([*map(str, words)])
    return out.getvalue()


def run_plat(*words: object) -> Ended:
    """Run ``plat`` with these words; a fault of plat's own, which would be a traceback there, is raised here."""
    code, out, err = 0, io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main([*map(str, words)])
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
            if isinstance(ended.code, str):
                print(ended.code, file=err)
    return Ended(code, out.getvalue(), err.getvalue())
