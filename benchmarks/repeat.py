"""Train the weights that come with plat again, by the commands that made them.

python benchmarks/repeat.py imagined-free-g1 --motions FOLDER --out runs/repeated --dry-run

The commands are those of docs/notes/weights.md. All that the weights come from is trained, one run after the other.
What is there already goes on or stays. Trainings are limited in time, so another machine makes other weights.
"""

import re
import shlex
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
import tyro
from roads import run
from shell_blocks import calls

from plat.bounds import Bounded, Positive
from plat.errors import ConfigError, PlatError
from plat.motions import load_motions, save_motions
from plat.runs import is_run, report_errors
from plat.words import counted, perhaps

PAGE = Path(__file__).parents[1] / "docs" / "notes" / "weights.md"
BANDAI, HARD = "bandai_train.npz", ("hard_free_train.npz", "hard_sa_train.npz", "hard_nc_train.npz")
TRAIN = (BANDAI, *HARD)
MOTIONS = {
    "TRAIN": TRAIN,
    "ALL": (*TRAIN, "asap_train.npz", "pbhc_train.npz"),
    "HARD": HARD,
    "ASAP": ("asap_train.npz",),
    "PBHC": ("pbhc_train.npz",),
    "hard_free_train.npz": HARD[:1],
}
"""Files that a word of the page stands for."""
EVERY = {"THIRD": 3, "SIXTH": 6}
"""Words that stand for one of so many Bandai-Namco clips, the first one among them."""
_STOPPED = re.compile(r"stopped after (\d+) minutes")
_GRACE = 600.0  # s for a training that is stopped to save itself


@dataclass(kw_only=True)
class RepeatConfig(Bounded):
    """Settings of training shipped weights again."""

    name: tyro.conf.Positional[str]
    """shipped weights, such as imagined-free-g1"""
    motions: Path
    """folder of the motion files: bandai_train.npz, hard_free_train.npz and others"""
    out: Path
    """folder of the runs"""
    given: tuple[str, ...] = ()
    """runs that no command makes, NAME=RUN each, of plat's own or of yours"""
    scale: Positive = 1.0
    """share of each training's minutes or steps, for a try"""
    dry_run: bool = False
    """print the commands alone"""


@dataclass(frozen=True)
class Command:
    """Command of plat that made a run.

    Attributes:
        words: behind ``plat``.
        weights: names of the section that it stands in, without ``-g1``.
        stopped: minutes after which it was stopped, before its budget was spent.
    """

    words: tuple[str, ...]
    weights: tuple[str, ...]
    stopped: float | None = None

    @property
    def made(self) -> str:
        """Return the run that it writes."""
        return self.words[self.words.index("--out") + 1]

    @property
    def needs(self) -> list[str]:
        """Return the runs that it reads: those in ``runs``, and a word that stands for another one."""
        named = (word for before, word in zip(self.words, self.words[1:], strict=False) if before == "--init")
        found = dict.fromkeys((*(word for word in self.words if word.startswith("runs/")), *named))
        return [word for word in found if word != self.made]


def commands(text: str) -> list[Command]:
    """Return the commands of a page that make a run, in its order.

    >>> page = "## `a`: b\\n```sh\\nplat average c --out runs/a   # stopped after 3 minutes\\n```"
    >>> commands(page)
    [Command(words=('average', 'c', '--out', 'runs/a'), weights=('a',), stopped=3.0)]
    """
    found = []
    for call in calls(text):
        if "--out" in call.words:
            stopped = _STOPPED.match(call.comment)
            weights = tuple(re.findall(r"`([\w-]+)`", call.section))
            found.append(Command(call.words, weights, float(stopped[1]) if stopped else None))
    return found


def chain(name: str, page: Sequence[Command], given: Mapping[str, str]) -> list[Command]:
    """Return the commands that make shipped weights, each after those whose runs it needs.

    Of several commands that write a run of one name, the last one before it is needed is meant.

    Args:
        name: of the weights.
        page: all commands, in order.
        given: runs that need not be made, by the name behind ``runs/``, or the word that stands for one.

    Raises:
        ConfigError: for other weights, or when a run is needed that no command makes.
    """
    short = name.removesuffix("-g1")
    own = [number for number, command in enumerate(page) if short in command.weights]
    if not own:
        known = sorted({f"{one}-g1" for command in page for one in command.weights})
        raise ConfigError(f"weights {name!r}: expected one of {', '.join(known)}{perhaps(name, known)}")
    last = max((number for number in own if Path(page[number].made).name == short), default=own[-1])
    wanted, missing, open_ends = {last}, dict[str, None](), [last]
    while open_ends:
        number = open_ends.pop()
        for needed in page[number].needs:
            if needed.removeprefix("runs/") in given:
                continue
            before = [other for other in range(number) if page[other].made == needed]
            if not before:
                missing[needed.removeprefix("runs/")] = None
            elif before[-1] not in wanted:
                wanted.add(before[-1])
                open_ends.append(before[-1])
    if missing:
        told = " and ".join(repr(one) for one in missing)
        shown = " ".join(f"{one}=RUN" for one in missing)
        raise ConfigError(f"weights {name!r} come from {told}, which no command makes: --given {shown}")
    return [page[number] for number in sorted(wanted)]


def placed(command: Command, config: RepeatConfig, given: Mapping[str, str]) -> Command:
    """Return a command on the files and in the folders of this machine."""
    words: list[str] = []
    flag = ""
    for word in command.words:
        behind, flag = flag, word if word.startswith("--") else flag
        bare = word.removeprefix("runs/")
        if behind == "--motions" and word in EVERY:
            words.append(str(part_path(config.out, word)))
        elif behind == "--motions" and word in MOTIONS:
            words += [str(config.motions / file) for file in MOTIONS[word]]
        elif bare in given and word != command.made:
            words.append(given[bare])
        elif bare != word:
            words.append(str(config.out / bare))
        elif behind == "--minutes" and word != flag:
            words.append(f"{float(word) * config.scale:g}")
        elif behind == "--steps" and word != flag:
            words.append(str(round(int(word) * config.scale)))
        else:
            words.append(word)
    stopped = None if command.stopped is None else command.stopped * config.scale
    return replace(command, words=tuple(words), stopped=stopped)


def part_path(out: Path, word: str) -> Path:
    """Return the file of a part of the Bandai-Namco clips."""
    return out / f"bandai_{word.lower()}.npz"


def without_gpu(words: Sequence[str]) -> list[str]:
    """Return the words of a command without the GPU that it had; it takes as long on the CPU and learns less."""
    place = words.index("--device") if "--device" in words else len(words)
    return [*words[:place], *words[place + 2 :]]


def train(command: Command) -> None:
    """Run a command, or what is left of it.

    Raises:
        PlatError: when it fails; what it printed stands above.
    """
    words, out = list(command.words), Path(command.made)
    stopped = out.with_name(f"{out.name}.stopped")
    if stopped.exists() or (words[0] == "average" and is_run(out)):
        return
    if is_run(out):
        words.append("--resume")
    if command.stopped is None:
        run(words)
        return
    stop_after(words, out, command.stopped)
    stopped.touch()


def stop_after(words: Sequence[str], out: Path, minutes: float) -> None:
    """Run a training that is told to end so many minutes after it has begun, and saves itself then.

    Raises:
        PlatError: when it fails before.
    """
    print("\nplat", *words, flush=True)
    process = subprocess.Popen([sys.executable, "-m", "plat", *words])
    begun = None
    try:
        while (status := process.poll()) is None:
            if begun is None and is_run(out):
                begun = time.monotonic()
            if begun is not None and time.monotonic() - begun >= 60 * minutes:
                process.terminate()
                process.wait(_GRACE)
                return
            time.sleep(0.5)
    finally:
        process.kill()
    if status:
        raise PlatError(f"plat {words[0]} ended with {status}; started again, this goes on from there")


def _given(config: RepeatConfig) -> dict[str, str]:
    given = {}
    for one in config.given:
        name, equals, place = one.partition("=")
        if not (name and equals and place):
            raise ConfigError(f"--given {one!r}: expected NAME=RUN")
        given[name] = place
    return given


def main(config: RepeatConfig) -> list[Command]:
    """Print the commands, run them unless told otherwise, and return them.

    Raises:
        ConfigError: for other weights, or when files or runs are missing.
    """
    given = _given(config)
    todo = chain(config.name, commands(PAGE.read_text(encoding="utf-8")), given)
    taken = {word for command in todo for word in command.words}
    files = {file for word, files in MOTIONS.items() if word in taken for file in files}
    files |= {BANDAI} if taken & EVERY.keys() else set()
    if lacking := sorted(file for file in files if not (config.motions / file).is_file()):
        raise ConfigError(f"--motions {str(config.motions)!r} has no {', '.join(lacking)}")
    todo = [placed(command, config, given) for command in todo]
    gpu = torch.cuda.is_available()
    if not gpu:
        todo = [replace(command, words=tuple(without_gpu(command.words))) for command in todo]
    minutes = sum(_minutes(command) for command in todo)
    print(
        f"{config.name}: {counted(len(todo), 'command')}, {minutes:.0f} minutes of training{'' if gpu else ', no GPU'}"
    )
    if config.dry_run:
        for command in todo:
            told = "" if command.stopped is None else f"   # stopped after {command.stopped:g} minutes"
            print(f"plat {shlex.join(command.words)}{told}")
        return todo
    for word in sorted(taken & EVERY.keys()):
        if not (part := part_path(config.out, word)).exists():
            config.out.mkdir(parents=True, exist_ok=True)
            save_motions(part, load_motions(config.motions / BANDAI)[:: EVERY[word]])
    for command in todo:
        train(command)
    made = todo[-1].made
    print(f"\nmade {made}; compare it: plat evaluate {made} {config.name} --motions FILES")
    return todo


def _minutes(command: Command) -> float:
    words = command.words
    planned = float(words[words.index("--minutes") + 1]) if "--minutes" in words else 0.0
    return planned if command.stopped is None else command.stopped


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(RepeatConfig, description=__doc__))
