import ast
from pathlib import Path

import plat
from plat.envs.motions.generation.digest import generator_digest

ROOT = Path(plat.__file__).parent
# change no number of a motion
HARMLESS = {"plat.errors", "plat.envs.motions.clip"}


def hashed_files(monkeypatch) -> list[Path]:
    read = Path.read_bytes
    seen = []
    monkeypatch.setattr(Path, "read_bytes", lambda path: seen.append(path) or read(path))
    generator_digest()
    return seen


def test_everything_that_hashed_files_import_is_hashed(monkeypatch):
    files = hashed_files(monkeypatch)
    modules = {".".join(("plat", *file.relative_to(ROOT).with_suffix("").parts)) for file in files}
    modules |= {module.removesuffix(".__init__") for module in modules}
    imported = {
        node.module
        for file in files
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("plat.")
    }
    assert {"plat.envs.robot", "plat.envs.motions.collision"} <= imported
    assert imported - modules == HARMLESS


def test_it_changes_with_any_of_the_files(monkeypatch):
    before, read = generator_digest(), Path.read_bytes
    for file in hashed_files(monkeypatch):
        edited = lambda path, file=file: read(path) + b"#" * (path == file)  # noqa: E731
        monkeypatch.setattr(Path, "read_bytes", edited)
        assert generator_digest() != before
