import subprocess
import sys

# in a process of its own: MuJoCo's settings are those of the process
PROGRAM = """
import sys
import mujoco
if sys.argv[1:]:
    config = mujoco.MjLogConfig.get()
    config.logfile = sys.argv[1]
    config.set()
from plat.robots.mjcf import compile_spec

spec = mujoco.MjSpec.from_string("<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>")
model = spec.compile()
data = mujoco.MjData(model)
data.qvel[:] = 1e30
mujoco.mj_step(model, data)
"""


def _run(folder, *words):
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *words], cwd=folder, capture_output=True, text=True, check=True
    )


def test_a_diverged_simulation_leaves_no_file_and_is_said(tmp_path):
    assert "simulation is unstable" in _run(tmp_path).stderr
    assert list(tmp_path.iterdir()) == []


def test_a_log_file_that_the_user_named_is_kept(tmp_path):
    _run(tmp_path, "mine.txt")
    assert "simulation is unstable" in (tmp_path / "mine.txt").read_text()
