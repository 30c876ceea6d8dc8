"""plat.deploy on a robot's computer: numpy is there, torch and the rest of plat's dependencies are not."""

import subprocess
import sys

# a finder that refuses comes before the real ones
BLOCK = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Refuse())
"""
HEAVY = ("torch", "tensordict", "torchrl", "mujoco", "gymnasium", "pydantic", "safetensors", "tyro", "wandb")


def run(code: str, blocked: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    program = BLOCK.format(names=blocked) + code
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)


def test_the_block_blocks():
    assert "No module named 'torch'" in run("import torch", HEAVY).stderr


def test_importing_needs_numpy_only():
    result = run("import plat.deploy; print(plat.__version__)", (*HEAVY, "onnxruntime"))
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip()


def test_gymnasium_still_knows_the_environment():
    result = run("import gymnasium, plat; print(gymnasium.spec('plat/G1TimedKeyframe-v0').id)", ("torch",))
    assert result.stdout.strip() == "plat/G1TimedKeyframe-v0", result.stderr
