from pathlib import Path

from plat.cli.options import AverageRecipe
from plat.runs.announce import next_command


def made(out: Path, **settings) -> AverageRecipe:
    return AverageRecipe(runs=(Path("a"),), out=out, **settings)


def test_files_that_are_not_there_are_not_named(tmp_path):
    for name in ("config.json", "model.safetensors"):
        (tmp_path / name).write_text("")
    first, second = next_command(made(tmp_path), "plat evaluate", tmp_path).splitlines()
    assert first == f"the run is in {tmp_path}: model.safetensors, config.json"
    assert second == f"next: plat evaluate {tmp_path}"


def test_the_next_command_is_for_the_same_robot_and_classes(tmp_path):
    lines = next_command(made(tmp_path, robot="toy.json", imports=("mine", "other")), "plat evaluate", "x")
    assert lines.endswith("plat evaluate x --robot toy.json --import mine --import other")


def test_words_are_quoted():
    assert next_command(made(Path("nowhere")), "plat evaluate", "a b").endswith("next: plat evaluate 'a b'")
