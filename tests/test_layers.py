"""The order of plat's rooms: a module imports what stands before it, and no imports go in a circle."""

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

import plat

LAYERS = [
    "moved",
    "lazy",
    "version",
    "words",
    "errors",
    "extras",
    "streams",
    "bounds",
    "progress",
    "files",
    "scratch",
    "pools",
    "json_file",
    "headless",
    "precision",
    "gpu",
    "spec",
    "entries",
    "rotations",
    "rotations_np",
    "deploy",
    "robots",
    "motions",
    "keyframes",
    "rendering",
    "envs",
    "tasks",
    "modules",
    "objectives",
    "collectors",
    "runs",
    "control",
    "evaluation",
    "export",
    "figures",
    "baselines",
    "studio",
    "weights",
    "cli",
    "__main__",
]
"""Rooms of the package, the lowest first. A module may import its own room and those before it."""

PACKAGE = Path(plat.__file__).parent


def sources(folder: Path) -> dict[str, Path]:
    """Files of a package by module name."""
    names = {}
    for path in sorted(folder.rglob("*.py")):
        parts = [folder.name, *path.relative_to(folder).with_suffix("").parts]
        names[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return names


def imports(name: str, path: Path, modules: Mapping[str, Path]) -> Iterator[tuple[str, int]]:
    """Modules of the package that a file imports, anywhere in it, with the line."""
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            # `from package import name` reaches for a module where there is one of that name
            targets = [full if (full := f"{base}.{alias.name}") in modules else base for alias in node.names]
        else:
            continue
        yield from ((target, node.lineno) for target in targets if target in modules)


def room(module: str) -> str:
    """Part of the package that a module belongs to; the package itself stands on top of all."""
    return module.removesuffix(".__main__").split(".")[1] if "." in module.removesuffix(".__main__") else ""


def violations(modules: Mapping[str, Path], layers: list[str]) -> list[str]:
    """Imports against the order, one a line."""
    height = {name: number for number, name in enumerate([*layers, ""])}
    return [
        f"{name}:{line} imports {target}"
        for name, path in modules.items()
        for target, line in imports(name, path, modules)
        if height[room(target)] > height[room(name)]
    ]


def circle(modules: Mapping[str, Path]) -> list[str]:
    """Modules that import each other in a ring; empty where there is no ring."""
    edges = {
        name: {target for target, _ in imports(name, path, modules)} - {name, "plat"} for name, path in modules.items()
    }
    done: set[str] = set()

    def visit(name: str, way: list[str]) -> list[str]:
        if name in way:
            return way[way.index(name) :]
        if name not in done:
            for target in sorted(edges[name]):
                if found := visit(target, [*way, name]):
                    return found
            done.add(name)
        return []

    return next((found for name in edges if (found := visit(name, []))), [])


def test_every_room_has_its_place() -> None:
    rooms = {room(name) for name in sources(PACKAGE)} - {""}
    assert rooms <= set(LAYERS), f"not in LAYERS: {sorted(rooms - set(LAYERS))}"


def test_modules_import_only_what_stands_before_them() -> None:
    assert violations(sources(PACKAGE), LAYERS) == []


def test_no_imports_in_a_circle() -> None:
    assert circle(sources(PACKAGE)) == []


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    folder = tmp_path / "toy"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "low.py").write_text("X = 1\n")
    (folder / "high.py").write_text("from toy.low import X\n")
    return folder


def test_imports_in_order_are_fine(toy: Path) -> None:
    assert violations(sources(toy), ["low", "high"]) == []
    assert circle(sources(toy)) == []


@pytest.mark.parametrize(
    "code",
    [
        "import toy.high\n",
        "from toy import high\n",
        "from .high import X\n",
        "def f():\n    from toy.high import X\n",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from toy.high import X\n",
    ],
)
def test_imports_against_the_order_are_found_wherever_they_hide(toy: Path, code: str) -> None:
    (toy / "low.py").write_text(code)
    assert [line.split(":")[0] for line in violations(sources(toy), ["low", "high"])] == ["toy.low"]
    assert set(circle(sources(toy))) == {"toy.low", "toy.high"}
