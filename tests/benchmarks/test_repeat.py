"""Shipped weights are made again by one command."""

import re
import sys
from functools import cache
from pathlib import Path

import pytest

from plat.cli import COMMANDS
from plat.cli.settings import parse
from plat.errors import ConfigError, PlatError
from plat.modules import Expert, ExpertConfig
from plat.motions import MotionClip, load_motions, save_motions
from plat.robots import G1
from plat.runs.locate import shipped_runs
from tests.motions.formats.writers import bowing_clip
from tests.recipes.runs import save_run

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import repeat
from repeat import PAGE, Command, RepeatConfig, chain, commands, main, train

ALL = commands(PAGE.read_text(encoding="utf-8"))
OPEN = {
    "expert-g1": ["FIRST"],
    "imagined-latent-g1": ["imagined-robot"],
    "imagined-robot-g1": ["robot-before"],
}
"""Weights that come from others which are in the history of the repository alone, and these."""


def given(name: str) -> dict[str, str]:
    return dict.fromkeys(OPEN.get(name, []), "plat-g1")


@cache
def is_understood(words: tuple[str, ...]) -> bool:
    return parse(COMMANDS[words[0]].kind(), list(words[1:]), f"plat {words[0]}") is not None


def small() -> Expert:
    return Expert(G1, ExpertConfig(hidden=(8,)))


@pytest.fixture
def motions(tmp_path) -> Path:
    """A folder with a file for every name, of which Bandai-Namco's has seven clips."""
    folder = tmp_path / "motions"
    folder.mkdir()
    clips = [MotionClip(f"bow_{number}", bowing_clip(60).qpos, 50.0) for number in range(7)]
    for name in {file for files in repeat.MOTIONS.values() for file in files}:
        save_motions(folder / name, clips if name == repeat.BANDAI else clips[:1])
    return folder


@pytest.fixture
def ran(monkeypatch) -> list[list[str]]:
    found: list[list[str]] = []
    monkeypatch.setattr(repeat, "run", found.append)
    return found


@pytest.mark.parametrize("name", sorted(shipped_runs()))
def test_all_that_weights_come_from_is_made_before_it_is_needed(name):
    made: set[str] = set()
    for command in (todo := chain(name, ALL, given(name))):
        assert is_understood(command.words)
        assert {need.removeprefix("runs/") for need in command.needs} <= made | given(name).keys()
        assert command.made.removeprefix("runs/") not in made, "nothing is made twice"
        made.add(command.made.removeprefix("runs/"))
    needed = {need for command in todo for need in command.needs}
    assert [command.made for command in todo if command.made not in needed] == [todo[-1].made]
    if name in OPEN:
        with pytest.raises(ConfigError, match=f"come from '{OPEN[name][0]}', which no command makes: --given"):
            chain(name, ALL, {})


def test_the_last_command_is_that_of_the_weights():
    made = {name: chain(name, ALL, given(name))[-1] for name in shipped_runs()}
    for name, command in made.items():
        assert Path(command.made).name == name.removesuffix("-g1")
        assert name.removesuffix("-g1") in command.weights
    assert len(chain("imagined-free-g1", ALL, {})) == 11
    assert [command.words[0] for command in chain("plat-generated-g1", ALL, {})] == ["expert", "distill", "refine"]


def test_other_weights_are_refused():
    with pytest.raises(ConfigError, match="weights 'imagine-g1': expected one of .*, perhaps 'imagined-g1'"):
        chain("imagine-g1", ALL, {})


def test_commands_are_run_on_the_files_of_the_machine(motions, tmp_path, ran, monkeypatch):
    stopped = []

    def stop_after(words, out, minutes):
        stopped.append((words, minutes))
        save_run(tmp_path / "out" / "latent-slowing", small())

    monkeypatch.setattr(repeat, "stop_after", stop_after)
    config = RepeatConfig(
        name="imagined-latent-g1",
        motions=motions,
        out=tmp_path / "out",
        given=("imagined-robot=imagined-robot-g1",),
        scale=0.5,
    )
    main(config)
    part = tmp_path / "out" / "bandai_sixth.npz"
    assert [clip.name for clip in load_motions(part)] == ["bow_0", "bow_6"]
    ((words, minutes),) = stopped
    assert minutes == 3
    assert words[words.index("--init-model") + 1] == "imagined-robot-g1"
    place = words.index("--motions")
    files = ("hard_free", "hard_sa", "hard_nc", "asap", "pbhc")
    assert words[place + 1 : place + 8] == [
        *(str(motions / f"{file}_train.npz") for file in files),
        str(part),
        "generated:train/wide@300",
    ]
    assert words[words.index("--minutes") + 1] == "30"
    assert ran[-1][:4] == [
        "average",
        *(str(tmp_path / "out" / name) for name in ("imagined-latent-before", "latent-third")),
        "--out",
    ]


def test_a_dry_run_makes_nothing_and_tells_what_is_missing(motions, tmp_path, ran, capsys):
    config = RepeatConfig(name="imagined-free-g1", motions=motions, out=tmp_path / "out", dry_run=True)
    main(config)
    out = capsys.readouterr().out
    assert out.startswith("imagined-free-g1: 11 commands, 391 minutes of training")
    assert "# stopped after 20 minutes" in out
    assert "$" not in out
    (motions / "hard_free_train.npz").unlink()
    with pytest.raises(ConfigError, match="has no hard_free_train.npz"):
        main(config)
    assert not ran
    assert not (tmp_path / "out").exists()


def test_what_is_there_goes_on_or_stays(tmp_path, ran):
    save_run(tmp_path / "there", small())
    train(Command(("average", "a", "--out", str(tmp_path / "there")), ()))
    assert not ran
    train(Command(("imagine", "--out", str(tmp_path / "there")), ()))
    train(Command(("imagine", "--out", str(tmp_path / "new")), ()))
    assert [words[-1] for words in ran] == ["--resume", str(tmp_path / "new")]


def test_a_training_is_stopped_once_and_a_failure_is_told(tmp_path):
    save_run(tmp_path / "run", small())
    never = Command(("imagine", "--out", str(tmp_path / "run")), (), stopped=1e-9)
    train(never)  # told to end before it began
    assert (tmp_path / "run.stopped").exists()
    failing = Command(("imagine", "--motions", "none.npz", "--out", str(tmp_path / "other")), (), stopped=5.0)
    with pytest.raises(PlatError, match="plat imagine ended with"):
        train(failing)
    assert not (tmp_path / "other.stopped").exists()


def test_minutes_and_steps_are_scaled(motions, tmp_path):
    config = RepeatConfig(name="plat-generated-g1", motions=motions, out=tmp_path, dry_run=True, scale=0.1)
    budgets = [word for command in main(config) for word in command.words if re.fullmatch(r"[\d.]+", word)]
    assert {"0.9", "0.5", "50000"} <= set(budgets)


def test_without_a_gpu_its_trainings_run_on_the_cpu():
    assert repeat.without_gpu(["imagine", "--device", "cuda", "--mirror"]) == ["imagine", "--mirror"]
    assert repeat.without_gpu(["imagine", "--mirror"]) == ["imagine", "--mirror"]
