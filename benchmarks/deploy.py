"""Benchmark of deployment: time of a robot's control step on one core: observation, network, joint targets.

python benchmarks/deploy.py plat/weights/plat
"""

import json
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import torch
import tyro

from plat.control import PolicyController, Simulator
from plat.deploy import ObservationBuilder, PolicyRunner
from plat.export import JointTargetNetwork, export_bundle
from plat.keyframes import standing
from plat.robots import G1
from plat.runs import load_policy, report_errors


@dataclass(kw_only=True)
class DeployBenchmark:
    """Settings of the deployment benchmark."""

    run: Annotated[Path, tyro.conf.Positional] = Path("plat/weights/plat")
    """run directory of a policy that chases keyframes"""
    rounds: int = 300
    """rounds of measurement"""
    calls: int = 20
    """control steps per measurement"""
    json: Path | None = None
    """file to write the results to"""


def main(benchmark: DeployBenchmark) -> dict[str, dict[str, float]]:
    """Run the benchmark: print a table, return its rows (microseconds)."""
    torch.set_num_threads(1)
    policy = load_policy(benchmark.run)
    with tempfile.TemporaryDirectory() as folder:
        export_bundle(benchmark.run, Path(folder) / "bundle")
        runner = PolicyRunner(Path(folder) / "bundle")
    simulator, pose = Simulator(G1.model()), standing(G1)
    simulator.reset(pose)
    state = simulator.state()
    keyframes = [pose, replace(pose, root_pos=pose.root_pos + 0.1)]
    observe = ObservationBuilder(runner.robot, runner.bundle.max_steps)
    network, controller = JointTargetNetwork(policy).eval(), PolicyController(policy.deployed(), G1)
    last_action = runner.robot.default_joint_pos * 0

    def new_keyframe() -> None:
        keyframes.reverse()
        observe(state, keyframes[0], 10, last_action)

    def torch_step() -> None:
        with torch.inference_mode():
            network(torch.from_numpy(observe(state, pose, 10, last_action)))

    layers: dict[str, Callable[[], object]] = {
        "observation": lambda: observe(state, pose, 10, last_action),
        "observation of a new keyframe": new_keyframe,
        "PolicyRunner, whole step": lambda: runner(state, pose, 10),
        "torch modules, whole step": torch_step,
        "torch on TensorDicts, whole step": lambda: controller(state, pose, 10),
    }
    times = _measure(layers, benchmark.rounds, benchmark.calls)
    rows = {name: {"least": min(values), "median": statistics.median(values)} for name, values in times.items()}
    print(f"{'one robot, one core':<36}{'least us':>10}{'median us':>11}")
    for name, row in rows.items():
        print(f"{name:<36}{row['least']:>10.0f}{row['median']:>11.0f}")
    if benchmark.json is not None:
        benchmark.json.write_text(json.dumps(rows, indent=2) + "\n")
    return rows


def _measure(layers: dict[str, Callable[[], object]], rounds: int, calls: int) -> dict[str, list[float]]:
    """Measure microseconds per call, each layer in turn, so that other load affects all of them."""
    times: dict[str, list[float]] = {name: [] for name in layers}
    for _ in range(rounds):
        for name, call in layers.items():
            started = time.perf_counter()
            for _ in range(calls):
                call()
            times[name].append(1e6 * (time.perf_counter() - started) / calls)
    return times


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(DeployBenchmark))
