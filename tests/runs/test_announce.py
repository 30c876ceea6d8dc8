from pathlib import Path

from plat.runs.announce import next_command


def test_files_that_are_not_there_are_not_named(tmp_path):
    for name in ("config.json", "model.safetensors"):
        (tmp_path / name).write_text("")
    first, second = next_command(tmp_path, "plat evaluate", tmp_path).splitlines()
    assert first == f"the run is in {tmp_path}: model.safetensors, config.json"
    assert second == f"next: plat evaluate {tmp_path}"


def test_the_next_command_is_for_the_same_robot(tmp_path):
    assert next_command(tmp_path, "plat evaluate", "x", robot="toy.json").endswith("plat evaluate x --robot toy.json")


def test_words_are_quoted():
    assert next_command(Path("nowhere"), "plat evaluate", "a b").endswith("next: plat evaluate 'a b'")
