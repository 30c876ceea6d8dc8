"""docs/deploy.md is true."""

import json
import re
from pathlib import Path

from plat.deploy import observation_terms
from plat.keyframes import KeyframeSequence, standing
from plat.robots import G1
from plat.spec.observation import OPTIONAL_GROUPS
from tests.deploy.test_import import HEAVY
from tests.deploy.test_import import run as run_program

PAGE = (Path(__file__).parents[2] / "docs" / "deploy.md").read_text()
(EXAMPLE,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def fields(content: object) -> set[str]:
    if isinstance(content, list):
        return set().union(*map(fields, content))
    if isinstance(content, dict):
        return set(content).union(*map(fields, content.values()))
    return set()


def test_every_field_is_explained(bundle):
    content = json.loads((bundle / "bundle.json").read_text())
    missing = {field for field in fields(content) if f"`{field}`" not in PAGE}
    assert not missing


def test_the_table_of_terms():
    rows = re.findall(r"^\| `([\w.]+)` \| (\d+)(?:-(\d+))? \| (\S+) \|", PAGE, re.MULTILINE)
    table = [(name, int(first), int(last or first) + 1, unit) for name, first, last, unit in rows]
    terms = observation_terms(G1.num_joints, len(G1.keypoints), OPTIONAL_GROUPS)
    assert table == [(term.name, term.start, term.stop, term.unit) for term in terms]


def test_the_loop_on_a_robot(bundle, tmp_path):
    """As it stands there, for a robot whose estimator and motors are stood in for."""
    KeyframeSequence(G1, standing(G1), (standing(G1).at(0.1),)).save(tmp_path / "wave.json")
    (tmp_path / "bundle").symlink_to(bundle)
    program = f"""
import os
from types import SimpleNamespace
import numpy as np
os.chdir({str(tmp_path)!r})
motor_names = {G1.joint_names!r}
sent = []
motors = SimpleNamespace(position=np.zeros(29), velocity=np.zeros(29), send=lambda *command: sent.append(command))
estimator = SimpleNamespace(position=np.zeros(3), orientation=np.array([1.0, 0, 0, 0]), velocity=np.zeros(3))
imu = SimpleNamespace(gyroscope=np.zeros(3))
def wait_for_next_step(seconds):
    time.sleep(seconds)
{EXAMPLE}
assert sent and all(part.shape == (29,) for command in sent for part in command)
print("arrived")
"""
    result = run_program(program, HEAVY)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "arrived"
