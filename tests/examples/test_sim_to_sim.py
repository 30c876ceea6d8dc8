from pathlib import Path

from tests.deploy.test_import import HEAVY, run

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


def test_it_is_short():
    assert len([line for line in EXAMPLE.read_text().splitlines() if line.strip()]) <= 45
