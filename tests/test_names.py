"""One name is one thing: no two classes of plat are called the same, and files are only where they are of one thing."""

import ast
from collections import Counter, defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]
FILES = sorted({path.resolve() for folder in ("plat", "recipes") for path in (ROOT / folder).rglob("*.py")})
SAME_THING = {
    "average.py",
    "bundle.py",
    "dynamics.py",
    "expert.py",
    "files.py",
    "finite.py",
    "goals.py",
    "groups.py",
    "kimodo.py",
    "kinematics.py",
    "observation.py",
    "options.py",
    "play.py",
    "reference.py",
    "settings.py",
    "sonic.py",
    "starts.py",
    "state.py",
    "symmetry.py",
}
"""Names that several files have, in one meaning: such as the model of the robot, its loss and its file."""


def test_no_class_name_stands_twice():
    places = defaultdict(list)
    for path in FILES:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:  # TorchRL's losses have an _AcceptedKeys each
            if isinstance(node, ast.ClassDef):
                places[node.name].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert len(places) > 300
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_no_file_name_has_two_meanings():
    count = Counter(path.name for path in FILES)
    assert {name for name, times in count.items() if times > 1} == SAME_THING | {"__init__.py"}
