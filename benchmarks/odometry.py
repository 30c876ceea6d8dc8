"""Drift of state estimation: a simulated robot follows motions, and an estimator that reads noisy sensors follows it.

python benchmarks/odometry.py plat/weights/imagined --motions bandai_val.npz --every 9
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from statistics import fmean, median
from typing import Annotated

import numpy as np
import torch
import tyro

from plat.bounds import Bounded, Count, Seed
from plat.cli.sim_to_sim import motion_keyframes
from plat.control import KeyframeScorer, PolicyController, SensorNoise, SimulatedSensors, Simulator
from plat.control.chase import ChaseStep
from plat.deploy import EstimatorSettings, RobotState, StateEstimator
from plat.errors import ActionError
from plat.files import replace_table
from plat.keyframes import KeyframeSequence
from plat.motions import MotionLibrary
from plat.robots import G1, describe_robot
from plat.rotations_np import quat_to_matrix
from plat.runs import load_policy, report_errors
from plat.words import percent


@dataclass(kw_only=True)
class OdometryBenchmark(Bounded):
    """Settings of the odometry benchmark."""

    run: Annotated[Path, tyro.conf.Positional] = Path("plat/weights/imagined")
    """run directory of a policy that chases keyframes"""
    motions: tuple[str, ...] = ("generated:val@60",)
    """motion files; keyframes are drawn along them"""
    every: Count = 1
    """use every so manyth clip"""
    closed: bool = False
    """the policy is given the estimate, not the truth"""
    perfect: bool = False
    """sensors without noise and bias"""
    torque: bool = True
    """motors report their torques"""
    floor: bool = True
    """the floor is known to be level"""
    control_rate: bool = False
    """the estimator reads the sensors once per control step, not at every physics step"""
    seed: Seed = 0
    """of commands, noise and biases"""
    csv: Path | None = None
    """file to write a row per clip to"""


@dataclass(frozen=True)
class ClipDrift:
    """Errors of the estimate over one clip."""

    clip: int
    seconds: float
    path: float
    """way of the root along the floor (m)"""
    drift: float
    """error of the horizontal position at the end (m)"""
    height: float
    """root mean square error of the height (m)"""
    tilt: float
    """root mean square angle between true and estimated vertical (rad)"""
    heading: float
    """error of the heading at the end (rad)"""
    speed: float
    """root mean square error of the velocity (m/s)"""
    fell: bool
    keyframes: int
    reached: int
    """keyframes that TKS@3 counts"""


def main(benchmark: OdometryBenchmark) -> list[ClipDrift]:
    """Run the benchmark: print a summary, return a row per clip."""
    torch.set_num_threads(1)
    policy = load_policy(benchmark.run)
    controller = PolicyController(policy.deployed(), G1)
    library = MotionLibrary.load(benchmark.motions, G1, dt=controller.timing.control_dt)
    sequences = motion_keyframes(library, benchmark.seed, controller.timing)[:: benchmark.every]
    simulator = Simulator(G1.model(), controller.timing.control_dt)
    rows = [follow(number, sequence, controller, simulator, benchmark) for number, sequence in enumerate(sequences)]
    report(rows)
    if benchmark.csv is not None:
        names = [field.name for field in fields(ClipDrift)]
        replace_table(benchmark.csv, names, ([str(getattr(row, name)) for name in names] for row in rows))
    return rows


def follow(
    number: int,
    sequence: KeyframeSequence,
    controller: PolicyController,
    simulator: Simulator,
    benchmark: OdometryBenchmark,
) -> ClipDrift:
    """Return the errors of the estimator while a robot chases a sequence."""
    controller.reset()
    simulator.reset(sequence.start)
    noise = None if benchmark.perfect else SensorNoise()
    sensors = SimulatedSensors(simulator, noise, seed=1000 * benchmark.seed + number)
    settings = EstimatorSettings(floor=0.0 if benchmark.floor else None)
    estimator = StateEstimator(describe_robot(G1, simulator.control_dt), settings)
    still = [sensors.read() for _ in range(200)]  # a second at rest
    first = (np.mean([getattr(each, name) for each in still], 0) for name in ("joint_pos", "gyro", "acceleration"))
    estimate = estimator.reset(*first)
    estimator.anchor(sequence.start)
    estimate.root_pos_w, estimate.root_quat_w = sequence.start.root_pos, sequence.start.root_quat
    scorer, errors, path, fell = KeyframeScorer(G1), [], 0.0, False
    time, truth = 0.0, simulator.state()
    while (command := sequence.command(time)) is not None:
        seen = estimate if benchmark.closed else truth
        target = controller(seen, command.keyframe, command.steps_left)
        before = truth
        try:
            readings = sensors.step(target)
        except ActionError:
            fell = True
            break
        if benchmark.control_rate:
            mean = np.mean([each.acceleration for each in readings], 0)
            readings = [replace(readings[-1], acceleration=mean, dt=simulator.control_dt)]
        for reading in readings:
            estimate = estimator.update(
                reading.joint_pos,
                reading.joint_vel,
                reading.gyro,
                reading.acceleration,
                reading.dt,
                reading.torque if benchmark.torque else None,
            )
        time += simulator.control_dt
        truth = simulator.state()
        step = ChaseStep(time, command, False, before, target, truth, sequence.sample(time), controller.timing)
        scorer.add(step)
        fell = fell or truth.root_pos_w[2] < 0.35
        if fell:
            break  # a robot on the floor is no business of leg odometry
        path += float(np.linalg.norm(truth.root_pos_w[:2] - before.root_pos_w[:2]))
        errors.append(list(_errors(estimate, truth)))
    drift, height, tilt, heading, speed = np.array(errors).T
    scores = scorer.scores()
    return ClipDrift(
        number, time, path, float(drift[-1]), _rms(height), _rms(tilt), float(heading[-1]), _rms(speed), fell,
        len(sequence), sum(score.success for score in scores),
    )  # fmt: skip


def report(rows: list[ClipDrift]) -> None:
    """Print a summary."""
    moved = [row for row in rows if row.path > 1.0]
    seconds, path = sum(row.seconds for row in rows), sum(row.path for row in rows)
    print(f"{len(rows)} clips, {seconds:.0f} s, {path:.0f} m, {sum(row.fell for row in rows)} falls")
    per_meter = 100 * sum(row.drift for row in moved) / max(sum(row.path for row in moved), 1e-9)
    middle = 100 * median(row.drift / row.path for row in moved) if moved else float("nan")
    ends = [100 * row.drift for row in rows]
    turned = np.degrees(sum(abs(row.heading) for row in rows))
    reached = sum(row.reached for row in rows) / sum(row.keyframes for row in rows)
    figures = {
        "drift": f"{per_meter:.2f} % of the way, median {middle:.2f} % ({len(moved)} clips of more than a meter)",
        "drift at the end": f"{fmean(ends):.1f} cm, largest {max(ends):.1f} cm",
        "height": f"{1000 * fmean(row.height for row in rows):.1f} mm",
        "tilt": f"{np.degrees(fmean(row.tilt for row in rows)):.2f} degrees",
        "heading": f"{turned / seconds * 60:.1f} degrees a minute",
        "velocity": f"{fmean(row.speed for row in rows):.3f} m/s",
        "TKS@3": f"{percent(100 * reached)} %",
    }
    for name, text in figures.items():
        print(f"{name:<20}{text}")


def _errors(estimate: RobotState, truth: RobotState) -> Iterator[float]:
    ours, right = quat_to_matrix(estimate.root_quat_w), quat_to_matrix(truth.root_quat_w)
    yield float(np.linalg.norm(estimate.root_pos_w[:2] - truth.root_pos_w[:2]))
    yield float(estimate.root_pos_w[2] - truth.root_pos_w[2])
    yield float(np.arccos(np.clip(ours[2] @ right[2], -1, 1)))
    # the turn about the vertical that is left between the two
    off = ours @ right.T
    yield float(np.arctan2(off[1, 0] - off[0, 1], off[0, 0] + off[1, 1]))
    yield float(np.linalg.norm(estimate.root_lin_vel_b - truth.root_lin_vel_b))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(OdometryBenchmark))
