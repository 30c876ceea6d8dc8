"""Static page: the studio as a folder of files that a browser runs alone, without a server."""

import json
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from plat.control.feasibility import WAY_PARTS, FeasibilityLimits
from plat.control.simulator import PHYSICS_STEPS
from plat.envs.reach import SAG
from plat.envs.settings import HOLD, ReachLimits
from plat.errors import StudioError
from plat.export import export_bundle
from plat.export.bundle_scene import scene_xml
from plat.files import check_folder
from plat.keyframes.chain_families import INSIDE
from plat.motions.retargeting.geometry import RobotGeometry
from plat.robots.mjcf import saved_model
from plat.robots.robot import Robot
from plat.robots.sole_points import sole_points
from plat.robots.symmetry import joint_symmetry, keypoint_symmetry
from plat.scratch import Scratch
from plat.spec.parts import Parts
from plat.spec.proportions import in_proportion
from plat.spec.timing import Timing
from plat.studio.pins import PRESETS, pin_bodies, preset
from plat.studio.policy_playback import nobody
from plat.studio.poser import BALLS, HANDLES, WHOLE, Poser
from plat.studio.templates import TEMPLATES
from plat.tasks.ways_around import FURTHER, MOVES

__all__ = ["LIBRARIES", "site_facts", "write_static"]

LIBRARIES = {
    "@mujoco/mujoco": ("3.14.0", ("mujoco.js", "mujoco.wasm")),
    "onnxruntime-web": (
        "1.30.0",
        ("dist/ort.wasm.bundle.min.mjs", "dist/ort-wasm-simd-threaded.mjs", "dist/ort-wasm-simd-threaded.wasm"),
    ),
    "three": (
        "0.187.0",
        (
            "build/three.module.js",
            "build/three.core.js",
            "examples/jsm/controls/OrbitControls.js",
            "examples/jsm/controls/TransformControls.js",
            "examples/jsm/utils/BufferGeometryUtils.js",
        ),
    ),
}
"""npm packages that the page needs: version, and the files of it."""

_NETWORK = "https://cdn.jsdelivr.net/npm"
_WEB = resources.files("plat.studio") / "web"
_SHARED = ("dock.js", "dock.css", "early.js", "icon.svg")
_FLOOR = '<geom name="floor" type="plane" size="0 0 .1" friction="0"/>'


def write_static(
    folder: Path, robot: Robot, runs: Mapping[str, Path], timing: Timing, libraries: Path | None = None
) -> None:
    """Write the static page to a folder that is not there yet.

    Args:
        folder: to make.
        robot: whose page it is; its description must not need files of meshes.
        runs: run directories by the name of their policy; those of experts cannot be exported.
        timing: that of the policy with the shortest commands.
        libraries: a ``node_modules`` folder with :data:`LIBRARIES`, which are copied; None for a page that loads them
            from a content delivery network.

    Raises:
        StudioError: when the folder is there, cannot be written, a library is missing, or the robot needs other files.
        BundleError: when a policy cannot be exported.
    """
    if folder.exists():
        raise StudioError(f"{str(folder)!r} is there already: choose another --static or remove it")
    check_folder(folder)
    facts = site_facts(robot, tuple(runs), timing)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with Scratch(f".{folder.name[:40]}-", folder.parent) as scratch:
            part = scratch / folder.name
            part.mkdir()
            _write_files(part, facts, libraries)
            for number, run in enumerate(runs.values()):
                export_bundle(run, part / "policies" / str(number))  # names may be paths, or no parts of addresses
            part.rename(folder)
    except OSError as error:
        raise StudioError(f"{str(folder)!r} could not be written ({error})") from error


def site_facts(robot: Robot, policies: tuple[str, ...], timing: Timing) -> dict[str, Any]:
    """Return what the page knows of a robot, as JSON values; the policies themselves are in folders of their own.

    Raises:
        StudioError: for a robot whose description needs other files.

    >>> from plat.robots import G1
    >>> facts = site_facts(G1, ("plat-g1",), Timing())
    >>> facts["robot"], len(facts["joints"]), facts["handles"]["left hand"]["body"]
    ('g1', 29, 'left_wrist_yaw_link')
    """
    model, poser = robot.shared_model, Poser(robot)
    partner, sign = joint_symmetry(robot)
    soles, reach = sole_points(robot, model), ReachLimits()
    doubts = FeasibilityLimits()
    return {
        "robot": robot.name,
        "xml": _description(robot, timing.control_dt / PHYSICS_STEPS),
        "control_dt": timing.control_dt,
        "max_steps": timing.max_steps,
        "hold": HOLD,
        "joints": list(robot.joint_names),
        "joint_bodies": [model.body(int(body)).name for body in model.jnt_bodyid[1:]],
        "joint_range": robot.joint_range.double().tolist(),
        "default_qpos": np.asarray(robot.default_qpos, dtype=np.float64).tolist(),
        "keypoints": list(robot.keypoints),
        "anchor": robot.anchor,
        "end_effectors": list(robot.end_effectors),
        "feet": list(robot.feet),
        "soles": [
            [{"pos": center.tolist(), "radius": float(radius)} for center, radius in zip(*foot, strict=True)]
            for foot in zip(*soles, strict=True)
        ],
        "mirror": {
            "partner": partner.tolist(),
            "sign": sign.tolist(),
            "keypoints": keypoint_symmetry(robot).tolist(),
        },
        "ankle_height": RobotGeometry.of(robot).ankle_height,
        "handles": {
            **{handle: _handle(robot, handle, *frame) for handle, frame in HANDLES.items()},
            WHOLE: {"body": None, "pos": [0.0, 0.0, 0.0], "ball": list(BALLS["robot"])},
        },
        "limbs": {handle: poser.limb(handle) for handle in HANDLES},
        "pins": pin_bodies(),
        "presets": {name: _names(preset(name, robot), robot) for name in PRESETS},
        "limits": {
            **{name: getattr(reach, name) for name in ("root", "joints", "bodies", "turn", "fallen_tilt")},
            "fallen_height": reach.fallen_below(robot.root_height),
            "sag": in_proportion(SAG, robot.root_height),
            **vars(reach.window),
            **vars(doubts),
        },
        "way_parts": WAY_PARTS,
        "around": {"moves": MOVES, "further": FURTHER, "inside": INSIDE},
        "templates": {name: [asdict(step) for step in steps] for name, steps in TEMPLATES.items()},
        "policies": list(policies),
        "nobody": nobody(policies),
    }


def _description(robot: Robot, timestep: float) -> str:
    """Return a description of the robot on a floor, in one text, with a physics step (s) in which it can be simulated.

    It is the file's own, whose numbers are not rounded, with the floor of :meth:`plat.robots.Robot.spec` as the last
    geom of the world; where that is another model, because the file includes others, has another physics step, or its
    limits are read otherwise, it is what MuJoCo writes of it.

    Raises:
        StudioError: for a robot whose description needs other files.
    """
    model, scene = robot.shared_model, scene_xml(robot, timestep)
    if model.nmesh or model.nhfield or scene is None:
        raise StudioError(f"robot {robot.name!r}: its description has meshes or textures, which this page cannot load")
    before, end, after = robot.asset_path.read_text(encoding="utf-8").rpartition("</worldbody>")
    text = f"{before}{_FLOOR}{end}{after}"
    with suppress(ValueError):  # of a text that includes what is beside the file
        if saved_model(mujoco.MjModel.from_xml_string(text)) == saved_model(robot.model(timestep=timestep)):
            return text
    return scene


def _names(commands: Parts | None, robot: Robot) -> dict[str, list[str]] | None:
    """Return what a choice commands, as in a keyframe file; None for the whole pose."""
    return None if commands is None else {field: names for field, names in commands.names(robot).items() if names}


def _handle(robot: Robot, handle: str, kind: str, name: str) -> dict[str, Any]:
    """Return the body of a handle, where on it the handle is, and where the ball to click on is (m, body frame)."""
    model, ball = robot.shared_model, list(BALLS[handle.split()[-1]])
    if kind == "body":
        return {"body": name, "pos": [0.0, 0.0, 0.0], "ball": ball}
    geom = model.geom(name).id
    return {"body": model.body(int(model.geom_bodyid[geom])).name, "pos": model.geom_pos[geom].tolist(), "ball": ball}


def _write_files(folder: Path, facts: dict[str, Any], libraries: Path | None) -> None:
    for name in _SHARED:
        (folder / name).write_bytes((_WEB / name).read_bytes())
    for file in (_WEB / "static").iterdir():
        if file.name != "index.html":
            (folder / file.name).write_bytes(file.read_bytes())
    base = {name: f"{_NETWORK}/{name}@{version}" for name, (version, _) in LIBRARIES.items()}
    if libraries is not None:
        base = {name: f"./libraries/{name}" for name in LIBRARIES}
        for name, (version, files) in LIBRARIES.items():
            _copy_library(libraries / name, folder / "libraries" / name, version, files)
    imports = {
        "mujoco": f"{base['@mujoco/mujoco']}/mujoco.js",
        "onnxruntime-web": f"{base['onnxruntime-web']}/dist/ort.wasm.bundle.min.mjs",
        "three": f"{base['three']}/build/three.module.js",
        "three/addons/": f"{base['three']}/examples/jsm/",
    }
    page = (_WEB / "static" / "index.html").read_text(encoding="utf-8")
    page = page.replace("IMPORTS", json.dumps({"imports": imports}))
    (folder / "index.html").write_text(page, encoding="utf-8")
    content = {**facts, "ort": f"{base['onnxruntime-web']}/dist/"}
    (folder / "site.json").write_text(json.dumps(content), encoding="utf-8")


def _copy_library(source: Path, target: Path, version: str, files: tuple[str, ...]) -> None:
    package = source / "package.json"
    try:
        found = json.loads(package.read_text(encoding="utf-8"))["version"]
    except (OSError, ValueError, KeyError):
        found = None
    if found != version:
        raise StudioError(
            f"{str(source)!r}: version {found or 'none'} of {source.name!r}, expected {version}: "
            f"npm install {' '.join(f'{name}@{wanted}' for name, (wanted, _) in LIBRARIES.items())}"
        )
    # whoever publishes the page passes the library on, which its license allows with that license beside it
    licenses = [path.name for path in source.glob("LICEN[CS]E*") if path.is_file()]
    for file in (*files, *licenses):
        (target / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / file, target / file)
