import ast
import shutil
from pathlib import Path

import pytest

import plat
from plat.envs.motions import digest

ROOT = Path(plat.__file__).parent


def test_everything_that_hashed_files_import_is_hashed(monkeypatch):
    read = Path.read_bytes
    files: list[Path] = []
    monkeypatch.setattr(Path, "read_bytes", lambda path: files.append(path) or read(path))
    digest.motion_code_digest()
    python = [file for file in files if file.suffix == ".py"]
    modules = {".".join(("plat", *file.relative_to(ROOT).with_suffix("").parts)) for file in python}
    modules |= {module.removesuffix(".__init__") for module in modules}
    imported = {
        node.module
        for file in python
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("plat.")
    }
    assert {"plat.envs.robot", "plat.envs.motions.collision"} <= imported
    assert imported - modules == {"plat.errors"}  # changes no number of a motion


@pytest.mark.parametrize(
    ("file", "counts"),
    [
        ("envs/motions/library.py", True),
        ("envs/motions/generation/families/legs.py", True),
        ("envs/motions/retargeting/skeletons/bandai.yaml", True),
        ("rotations.py", True),
        ("envs/tracking.py", False),
    ],
)
def test_it_changes_with_the_code_that_tables_depend_on(tmp_path, monkeypatch, file, counts):
    copy = shutil.copytree(ROOT, tmp_path / "plat", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(digest, "__file__", str(copy / "envs" / "motions" / "digest.py"))
    before = digest.motion_code_digest()
    assert before == digest.motion_code_digest()
    with (copy / file).open("a") as source:
        source.write("# edited\n")
    assert (digest.motion_code_digest() != before) is counts
