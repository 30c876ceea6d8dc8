"""Bundle export: network, metadata, model card and a worked example, from a run directory."""

import hashlib
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from plat.control.simulator import PHYSICS_STEPS
from plat.deploy import PolicyRunner, RobotDescription, RobotState
from plat.deploy.bundle import INPUT, METADATA_KEY, OUTPUT, Bundle, readable_json
from plat.deploy.onnx_session import open_session
from plat.deploy.runner import BUNDLE_FILE, NETWORK_FILE
from plat.errors import BundleError, RenderingError
from plat.export.bundle_scene import scene_xml
from plat.export.card import model_card
from plat.export.facts import describe_policy
from plat.export.network import JointTargetNetwork
from plat.export.onnx_file import onnx_model
from plat.files import as_path, check_folder
from plat.keyframes import Keyframe
from plat.modules import Expert, ObservationNormalizer
from plat.robots import Robot
from plat.runs import SavedRun
from plat.scratch import Scratch

__all__ = ["EXAMPLE_FILE", "TOLERANCE", "ExportCheck", "export_bundle"]

CARD_FILE, EXAMPLE_FILE, SCENE_FILE, PICTURE_FILE = "README.md", "example.json", "scene.xml", "picture.png"
TOLERANCE = 1e-4
"""Largest difference between exported and torch policy that is let through (rad)."""
_CHECKED_ROWS = 1024


@dataclass(frozen=True)
class ExportCheck:
    """Result of comparing the exported network with the torch policy."""

    rows: int
    """number of observations compared"""
    max_difference: float
    """largest absolute difference of a joint position target (rad)"""


def export_bundle(run: str | Path, out: str | Path, *, picture: bool = False) -> ExportCheck:
    """Write the deployed policy of a run as a bundle that :class:`plat.deploy.PolicyRunner` runs.

    The files are checked after they are written. The folder appears when all of them are right, or not at all.
    Leftovers of a killed export are removed by the next one.

    Args:
        run: run directory of ``plat distill`` or ``plat refine``.
        out: folder to make.
        picture: draw the robot for the model card, where OpenGL and imageio are there.

    Raises:
        CheckpointError: when the run or its scores cannot be read.
        BundleError: when ``out`` is there already, the run holds an expert or a policy that reads more than a robot
            observes, the disk does not take the files, a package is missing, or the exported network and torch differ
            by more than :data:`TOLERANCE`.
    """
    run, out = as_path(run, "run", BundleError), as_path(out, "bundle", BundleError)
    if out.exists():
        raise BundleError(f"{str(out)!r} is there already: choose another --out or remove it")
    check_folder(out)
    saved = SavedRun(run)
    policy = saved.policy()
    if isinstance(policy, Expert):
        raise BundleError(
            f"{str(run)!r} holds an expert, which follows dense reference motion, expected a policy that chases "
            "keyframes: a run of plat distill or plat refine"
        )
    network = JointTargetNetwork(policy).eval()
    bundle = describe_policy(policy, saved)
    model = onnx_model(network, network.num_features, {METADATA_KEY: bundle.to_json()})
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with Scratch(f".{out.name[:40]}-", out.parent) as scratch:
            part = scratch / out.name
            part.mkdir()
            network_file = model.SerializeToString()
            (part / NETWORK_FILE).write_bytes(network_file)
            hashed = replace(bundle, network_sha256=hashlib.sha256(network_file).hexdigest())
            (part / BUNDLE_FILE).write_text(hashed.to_json(), encoding="utf-8")
            check = _check(part / NETWORK_FILE, network)
            files = _optional_files(part, policy.robot, bundle.robot.control_dt, picture)
            card = model_card(bundle, saved, check.max_difference, files)
            (part / CARD_FILE).write_text(card, encoding="utf-8")
            example = _example(part, network, bundle)
            (part / EXAMPLE_FILE).write_text(readable_json(example), encoding="utf-8")
            os.rename(part, out)
    except OSError as error:
        raise BundleError(f"{str(out)!r} could not be written ({error.strerror or error})") from error
    return check


def _optional_files(folder: Path, robot: Robot, control_dt: float, picture: bool) -> list[str]:
    """Write scene and picture where they can be made; return their names."""
    files = []
    # physics steps of training, whatever the robot's file says: they divide the control step
    if (scene := scene_xml(robot, control_dt / PHYSICS_STEPS)) is not None:
        (folder / SCENE_FILE).write_text(scene, encoding="utf-8")
        files.append(SCENE_FILE)
    if picture:
        from plat.rendering import Stage, write_picture  # OpenGL: most exports draw nothing

        try:
            with Stage(robot) as stage:
                stage.look_at(robot.default_qpos)
                write_picture(folder / PICTURE_FILE, stage.draw(robot.default_qpos))
            files.append(PICTURE_FILE)
        except RenderingError:  # a card without a picture says the same
            pass
    return files


@torch.no_grad()
def _check(path: Path, network: JointTargetNetwork) -> ExportCheck:
    """Compare on observations drawn like those of training, one by one and in a batch."""
    observation = torch.randn(_CHECKED_ROWS, network.num_features, generator=torch.Generator().manual_seed(0))
    for part in network.parts:
        if isinstance(part, ObservationNormalizer) and part.mean.shape == observation.shape[1:]:
            observation = part.mean + part.var.sqrt() * observation
            break
    session = open_session(path)
    batch = session.run([OUTPUT], {INPUT: observation.numpy()})[0]
    single = np.concatenate([session.run([OUTPUT], {INPUT: row[None].numpy()})[0] for row in observation])
    expected = network(observation).numpy()
    difference = float(max(np.abs(batch - expected).max(), np.abs(single - expected).max()))
    if not difference <= TOLERANCE:  # not >, which NaN would pass
        raise BundleError(
            f"exported and torch policy differ by {difference:.3g} rad, expected at most {TOLERANCE:g}: nothing written"
        )
    return ExportCheck(_CHECKED_ROWS, difference)


@torch.no_grad()
def _example(folder: Path, network: JointTargetNetwork, bundle: Bundle) -> dict[str, Any]:
    """Return one step from state and keyframe to joint targets, for other implementations to check against."""
    robot = bundle.robot
    state, keyframe, last_action = _some_step(robot)
    steps_left = min(20, bundle.max_steps)
    observation = bundle.observation_builder()(state, keyframe, steps_left, last_action)
    target = network(torch.from_numpy(observation)).numpy()
    runner = PolicyRunner(folder, robot.joint_names)
    runner.reset(robot.default_joint_pos + robot.action_scale * last_action)
    difference = float(np.abs(runner(state, keyframe, steps_left) - target).max())
    if not difference <= TOLERANCE:
        raise BundleError(f"runner and torch policy differ by {difference:.3g} rad, expected at most {TOLERANCE:g}")
    return {
        "state": {name: values.tolist() for name, values in asdict(state).items()},
        "keyframe": {name: getattr(keyframe, name).tolist() for name in ("root_pos", "root_quat", "joint_pos")},
        "steps_left": steps_left,
        "last_action": last_action.tolist(),
        INPUT: observation.tolist(),
        OUTPUT: target.tolist(),
    }


def _some_step(robot: RobotDescription) -> tuple[RobotState, Keyframe, np.ndarray]:
    """Return a random robot state near the default pose, a pose nearby, and a last action."""
    random = np.random.default_rng(0)
    low, high = robot.joint_range.T

    def joint_pos() -> np.ndarray:
        return np.clip(robot.default_joint_pos + random.normal(0, 0.2, len(low)), low, high)

    def quat() -> np.ndarray:
        values = np.array([1.0, 0, 0, 0]) + random.normal(0, 0.1, 4)
        return values / np.linalg.norm(values)

    def vector(scale: float) -> np.ndarray:
        return random.normal(0, scale, 3)

    # away from the origin, so that mixed-up frames show
    root_pos = robot.default_qpos[:3] + np.array((1.0, 2.0, 0.0))
    state = RobotState(joint_pos(), random.normal(0, 0.5, len(low)), root_pos, quat(), vector(0.3), vector(0.3))
    keyframe = Keyframe(0.4, root_pos + vector(0.1), quat(), joint_pos())
    return state, keyframe, random.normal(0, 0.5, len(low))
