import runpy
from pathlib import Path

import pytest

from plat.export import export_bundle
from plat.keyframes import KeyframeSequence, standing
from plat.modules import PlainPolicy, PlainPolicyConfig
from plat.robots import G1
from plat.spec.timing import Timing
from tests.deploy.test_import import HEAVY, run
from tests.export.runs import write_run

EXAMPLE = Path(__file__).parents[2] / "examples" / "sim_to_sim.py"


def test_it_arrives_without_torch(shipped_bundle):
    program = f"""
import runpy
from pathlib import Path
print(runpy.run_path({str(EXAMPLE)!r})["main"](Path({str(shipped_bundle)!r})))
"""
    result = run(program, tuple(name for name in HEAVY if name != "mujoco"))
    assert result.returncode == 0, result.stderr
    assert float(result.stdout) < 0.1


def test_a_file_of_keyframes_for_a_policy_of_short_commands(tmp_path, quick_exports):
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    timing, pose = Timing(max_steps=10), standing(G1)
    policy = PlainPolicy(G1, PlainPolicyConfig(backbone=(8,), decoder=(8,), timing=timing))
    export_bundle(write_run(tmp_path / "run", policy), tmp_path / "bundle")
    KeyframeSequence(G1, pose, (pose.at(0.1),), timing).save(tmp_path / "stand.json")
    assert runpy.run_path(str(EXAMPLE))["main"](tmp_path / "bundle", tmp_path / "stand.json") < 0.5


def test_it_is_short():
    assert len([line for line in EXAMPLE.read_text().splitlines() if line.strip()]) <= 45
