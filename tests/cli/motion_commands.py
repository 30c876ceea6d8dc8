import tyro

from plat.cli import motions
from plat.cli.options import MotionsCommand


def run(*arguments: object):
    """Run ``plat motions`` in this process, and return what it made."""
    return motions.main(tyro.cli(MotionsCommand, args=[str(argument) for argument in arguments]))
