"""What is packed holds the whole package and nothing beside it, with its license."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BESIDE = {"CHANGELOG.md", "CITATION.cff", "LICENSE", "MANIFEST.in", "NOTICE", "README.md", "pyproject.toml"}
BUILD = "import setuptools.build_meta as backend; backend.build_{kind}({folder!r})"


def package() -> set[str]:
    """Files of the package as they are imported: what stands in recipes/ is in plat/recipes/."""
    return {
        Path(folder, name).relative_to(ROOT).as_posix()
        for folder, _, names in os.walk(ROOT / "plat", followlinks=True)
        for name in names
        if not folder.endswith("__pycache__")
    }


def copy_small(old: str, new: str) -> None:
    """Copy a file; of weights the name is enough, as packing them takes seconds."""
    if new.endswith(".safetensors"):
        Path(new).touch()
    else:
        shutil.copy(old, new)


def build(kind: str, source: Path, folder: Path) -> Path:
    folder.mkdir()
    command = [sys.executable, "-c", BUILD.format(kind=kind, folder=str(folder))]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (built,) = folder.iterdir()
    return built


@pytest.mark.slow
def test_a_source_distribution_and_the_wheel_of_it_are_complete(tmp_path):
    pytest.importorskip("setuptools", minversion="77")
    source = tmp_path / "source"
    for folder in ("plat", "recipes", "tests"):
        shutil.copytree(
            ROOT / folder,
            source / folder,
            symlinks=True,
            ignore=shutil.ignore_patterns("__pycache__"),
            copy_function=copy_small,
        )
    for name in BESIDE:
        shutil.copy(ROOT / name, source)

    packed = build("sdist", source, tmp_path / "sdist")
    with tarfile.open(packed) as archive:
        assert all(member.isfile() or member.isdir() for member in archive)  # links would lead out of it
        archive.extractall(tmp_path)
        unpacked = tmp_path / packed.name.removesuffix(".tar.gz")
    files = {path.relative_to(unpacked).as_posix() for path in unpacked.rglob("*") if path.is_file()}
    made = {name for name in files if name in ("PKG-INFO", "setup.cfg") or name.startswith("plat_rl.egg-info/")}
    assert files - made == package() | BESIDE

    with zipfile.ZipFile(build("wheel", unpacked, tmp_path / "wheel")) as wheel:
        names = {name for name in wheel.namelist() if not name.endswith("/")}
    about = {name for name in names if name.partition("/")[0].endswith(".dist-info")}
    assert names - about == package()
    assert {"LICENSE", "NOTICE"} <= {Path(name).name for name in about}
