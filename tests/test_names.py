"""One name is one thing: no two classes of plat are called the same."""

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_no_class_name_stands_twice():
    places = defaultdict(list)
    found = {path.resolve() for folder in ("plat", "recipes") for path in (ROOT / folder).rglob("*.py")}
    for path in sorted(found):  # plat/recipes is a link to recipes
        for node in ast.parse(path.read_text(encoding="utf-8")).body:  # TorchRL's losses have an _AcceptedKeys each
            if isinstance(node, ast.ClassDef):
                places[node.name].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert len(places) > 300
    assert {name: where for name, where in places.items() if len(where) > 1} == {}
