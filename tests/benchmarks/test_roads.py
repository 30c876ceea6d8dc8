import csv
import sys
from pathlib import Path

import pytest

from plat.cli import COMMANDS
from plat.cli.settings import parse
from plat.errors import ConfigError

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import roads
from roads import ROADS, RoadsConfig, commands, main, table


@pytest.fixture
def config(tmp_path):
    return RoadsConfig(motions=("generated:train",), tests=("generated:val",), out=tmp_path, minutes=10.0, seeds=(0, 1))


@pytest.mark.parametrize("road", ROADS)
def test_every_stage_is_a_command_of_plat(config, road):
    minutes, made = 0.0, set()
    for folder, (name, *words) in commands(config, road, seed=1):
        settings = parse(COMMANDS[name].kind(), words, f"plat {name}")
        assert settings.out == folder
        assert settings.seed == 1
        for needed in ("expert", "student", "init_model"):
            value = getattr(settings, needed, None)
            assert not isinstance(value, Path) or value in made
        minutes += settings.minutes
        made.add(folder)
    assert minutes == pytest.approx(10.0)
    assert folder.name == f"{road}_1"


def test_roads_share_what_is_the_same(config):
    model, finetune = commands(config, "model", seed=1), commands(config, "finetune", seed=1)
    assert model[:2] == finetune[:2]
    assert model[2] != finetune[2]
    assert commands(config, "ppo", seed=1)[1] != model[1]


def test_all_roads_are_trained_then_scored_together(config, monkeypatch):
    ran = []

    def run(words):
        ran.append(words)
        if words[0] == "evaluate":
            write_scores(Path(words[-1]), [Path(word).name for word in words[1:11]])

    monkeypatch.setattr(roads, "run", run)
    rows = main(config)
    assert [words[0] for words in ran].count("imagine") == 4
    assert [words[0] for words in ran].count("expert-model") == 2
    assert ran[-1][0] == "evaluate"
    assert len(rows) == 5 * 3
    with (config.out / "roads.csv").open(newline="") as file:
        assert list(csv.DictReader(file)) == rows


def write_scores(path, names):
    cells = [(name, metric, 90 + 10 * number) for number, name in enumerate(names) for metric in METRICS]
    rows = [(name, "mixed", 1, metric, value, 0, 0) for name, metric, value in cells]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([("policy", "horizon", "seeds", "metric", "value", "low", "high"), *rows])


METRICS = ("tks", "mpjpe", "mpkpe", "fall_rate")


def test_a_row_is_the_mean_of_the_seeds(tmp_path):
    write_scores(tmp_path / "scores.csv", ["a_0", "a_1", "b_0"])
    rows = table({"val": tmp_path / "scores.csv"}, {"a_0": "ppo", "a_1": "ppo", "b_0": "imagine"}, 30.0)
    assert len(rows) == 6
    assert rows[0] == {
        "test": "val", "horizon": "mixed", "road": "ppo", "metric": "tks", "minutes": "30",
        "seeds": "2", "mean": "95", "low": "90", "high": "100",
    }  # fmt: skip


def test_too_little_time_is_refused(config):
    config.minutes = 0.01
    with pytest.raises(ConfigError, match="a second of each stage"):
        main(config)
