"""MJCF descriptions: files to editable specs, and the contact geometry of the soles."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import mujoco
import numpy as np

from plat.bounds import Positive, check_value
from plat.errors import ConfigError, RobotError
from plat.json_file import short
from plat.robots.contact_geoms import colliding_geoms
from plat.robots.motors import check_actuators
from plat.robots.mujoco_log import leave_no_log_file
from plat.words import counted, perhaps

__all__ = [
    "FLOOR",
    "FOOT_COUNTS",
    "Capsule",
    "add_floor",
    "add_foot_counts",
    "asset_path",
    "check_model",
    "compile_spec",
    "leave_out_floors",
    "read_spec",
    "replace_soles",
    "saved_model",
]

FOOT_COUNTS = {"left_foot_contact": "left_foot_count", "right_foot_contact": "right_foot_count"}
"""Contact sensors of the feet, and those of :func:`add_foot_counts` beside them."""

FLOOR = "floor"
"""Name of the plane that plat adds."""

_LONGEST_NAME = 255
_ROOT = 1  # MuJoCo's index of the first body; 0 is the world
# What a contact sensor is of: a geom, a body, or one with all below it.
_GEOM, *_BODIES = (int(getattr(mujoco.mjtObj, f"mjOBJ_{kind}")) for kind in ("GEOM", "BODY", "XBODY"))

leave_no_log_file()  # here: no model comes into being without this module


@dataclass(frozen=True)
class Capsule:
    """A capsule of a foot's contact geometry, in the frame of the foot body."""

    start: tuple[float, float, float]
    """center of one end (m)"""
    end: tuple[float, float, float]
    """center of the other end (m)"""
    radius: float = 0.01
    """m"""

    def __post_init__(self) -> None:
        """Check the numbers."""
        point = tuple[float, float, float]
        try:
            for name, kind in (("start", point), ("end", point), ("radius", Positive)):
                check_value(f"sole capsule: {name}", getattr(self, name), kind)
        except ConfigError as error:
            raise RobotError(str(error)) from None


def asset_path(asset: str) -> Path:
    """Return the path of an MJCF file: one of plat's own by its file name, any other by its path."""
    own = Path(str(resources.files("plat.robots"))) / "assets" / asset
    # os.path: a name that is too long for a file is that of none
    return own if Path(asset).name == asset and os.path.exists(own) else Path(asset)


def read_spec(asset: str, robot: str) -> mujoco.MjSpec:
    """Read an MJCF file.

    Args:
        asset: see :func:`asset_path`.
        robot: name of the robot, for messages.

    Raises:
        RobotError: when there is no such file, or MuJoCo cannot parse it.
    """
    path = asset_path(asset)
    if not os.path.isfile(path):
        named = repr(asset) if len(asset) <= _LONGEST_NAME else short(asset)
        raise RobotError(f"robot {robot!r}: asset {named}: no such file, expected an MJCF description")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise RobotError(f"robot {robot!r}: asset {asset!r}: not a readable MJCF file ({_one_line(error)})") from None


def leave_out_floors(spec: mujoco.MjSpec, where: str) -> tuple[str, ...]:
    """Take level planes at height 0 out of a description's world, and return a line for them; plat adds its own.

    A second floor would double every contact, and its friction would take the place of the soles' own.

    Args:
        spec: description that is changed.
        where: robot and file; begins messages.
    """
    planes = [geom for geom in spec.worldbody.geoms if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]
    if not planes:
        return ()
    try:
        model = spec.copy().compile()
    except (ValueError, mujoco.FatalError):
        return ()  # said when the description is compiled
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    level = [
        plane
        for plane, geom in zip(planes, np.flatnonzero(_world_planes(model)), strict=True)
        if data.geom_xmat[geom, 8] > 1 - 1e-6 and abs(data.geom_xpos[geom, 2]) < 1e-6
    ]
    names = ", ".join(repr(plane.name) if plane.name else "without a name" for plane in level)
    for plane in level:
        spec.delete(plane)
    return (f"{where}: its floor {names} is left out: plat adds its own, at height 0",) if level else ()


def _world_planes(model: mujoco.MjModel) -> np.ndarray:
    return (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_bodyid == 0)


def add_floor(spec: mujoco.MjSpec) -> None:
    """Add a level floor at height 0."""
    floor = spec.worldbody.add_geom(name=FLOOR, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.1])
    floor.friction[0] = 0.0  # a contact has the larger one of both geoms: so it is the robot's, whatever that is


def compile_spec(spec: mujoco.MjSpec, asset: str, robot: str) -> mujoco.MjModel:
    """Compile a description.

    Raises:
        RobotError: when MuJoCo refuses it.
    """
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise RobotError(f"robot {robot!r}: asset {asset!r} does not compile ({_one_line(error)})") from None


def saved_model(model: mujoco.MjModel) -> bytes:
    """Return a compiled model as MuJoCo saves it."""
    content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content.tobytes()


def check_model(model: mujoco.MjModel, robot: str, bodies: Mapping[str, Sequence[str]], asset: str) -> None:
    """Check what plat relies on: the bodies, a free root joint, hinges, and one actuator per hinge in order.

    Args:
        model: compiled.
        robot: name of the robot, for messages.
        bodies: names of bodies by the field that holds them; the first of ``keypoints`` is the root.
        asset: the file, for messages.

    Raises:
        RobotError: naming what is missing, or the body, joint or actuator that plat would take for another one.
    """
    known = [model.body(index).name for index in range(1, model.nbody)]
    for field, names in bodies.items():
        if missing := [name for name in names if name not in known]:
            near = perhaps(missing[0], known)
            raise RobotError(f"robot {robot!r}: {field}: body {missing[0]!r} is not in {asset}{near}")
    where = f"robot {robot!r}: {asset}"
    free, hinge = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_HINGE)
    types = model.jnt_type.tolist()
    if len(types) < 2 or types != [free] + [hinge] * (len(types) - 1):
        raise RobotError(f"robot {robot!r}: the joints of {asset} are not one free joint followed by hinges")
    if model.jnt_bodyid[0] != _ROOT:
        owner, first = (model.body(index).name for index in (model.jnt_bodyid[0], _ROOT))
        raise RobotError(f"{where}: the free joint is that of body {owner!r}, expected the first body, {first!r}")
    root = bodies["keypoints"][0]
    if root != model.body(_ROOT).name:
        raise RobotError(
            f"robot {robot!r}: keypoints: the first is {root!r}, expected the root, {model.body(_ROOT).name!r}"
        )
    driven = [int(joint) for joint in model.actuator_trnid[:, 0]]
    if driven != list(range(1, model.njnt)):
        odd = ""
        if sorted(driven) == list(range(1, model.njnt)):
            number = next(index for index, joint in enumerate(driven) if joint != index + 1)
            drives, hinge_there = (model.joint(index).name for index in (driven[number], number + 1))
            odd = f"; actuator {number + 1} drives {drives!r}, and hinge {number + 1} is {hinge_there!r}"
        raise RobotError(
            f"{where} has {counted(len(driven), 'actuator')}, expected one position actuator for each of the "
            f"{model.njnt - 1} hinges, in their order{odd}"
        )
    _check_hinges(model, where)
    check_actuators(model, where)
    _check_alone(model, where)
    _check_foot_sensors(model, bodies["feet"], where)


def _check_hinges(model: mujoco.MjModel, where: str) -> None:
    """Check what forward kinematics and joint limits rely on."""
    for body in range(model.nbody):
        if model.body_jntnum[body] > 1:
            name, hinges = model.body(body).name, model.body_jntnum[body]
            raise RobotError(f"{where}: body {name!r} has {hinges} hinges, expected one; give each a body of its own")
    for index in range(1, model.njnt):
        joint = f"{where}: joint {model.joint(index).name!r}"
        if model.jnt_pos[index].any():
            raise RobotError(f"{joint} is off its body's origin; set its pos to 0 0 0")
        if ref := model.qpos0[model.jnt_qposadr[index]]:
            raise RobotError(f"{joint} has ref {ref:g} rad, expected none; give its body its pose at angle 0")
        if not model.jnt_limited[index]:
            raise RobotError(f"{joint} has no limits, expected its range")


def _check_alone(model: mujoco.MjModel, where: str) -> None:
    """Check that the robot can run into nothing but plat's floor, which has no friction of its own."""
    for geom in np.flatnonzero(colliding_geoms(model) & (model.body_rootid[model.geom_bodyid] != _ROOT)).tolist():
        name, body = model.geom(geom).name, model.body(model.geom_bodyid[geom]).name
        if name != FLOOR:
            told = f"geom {name!r}" if name else "a geom without a name"
            raise RobotError(
                f"{where}: {told} of body {body!r} collides with the robot, expected the robot alone: plat adds a "
                "floor; remove it, or set its contype and conaffinity to 0"
            )


def _check_foot_sensors(model: mujoco.MjModel, feet: Sequence[str], where: str) -> None:
    """Check that no contact sensor of a foot is that of the other one."""
    others = [model.body(foot).id for foot in reversed(feet)]
    for name, foot, other in zip(FOOT_COUNTS, feet, others, strict=True):
        sensor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, name)
        if sensor < 0 or model.sensor_type[sensor] != mujoco.mjtSensor.mjSENS_CONTACT or model.body(foot).id == other:
            continue
        sides = (
            (model.sensor_objtype[sensor], model.sensor_objid[sensor]),
            (model.sensor_reftype[sensor], model.sensor_refid[sensor]),
        )
        for kind, number in sides:
            body = model.geom_bodyid[number] if kind == _GEOM else number if kind in _BODIES else -1
            if body == other:
                raise RobotError(
                    f"{where}: sensor {name!r} is of body {model.body(other).name!r}, expected {foot!r}, the "
                    f"{name.partition('_')[0]} one of its feet"
                )


def replace_soles(spec: mujoco.MjSpec, feet: Sequence[str], capsules: Sequence[Capsule]) -> None:
    """Replace every colliding geom of the feet by capsules, which keep the class of the first of these geoms.

    Args:
        spec: description that is changed.
        feet: names of the foot bodies.
        capsules: the same for each foot.
    """
    for name in feet:
        body = spec.body(name)
        soles = [geom for geom in body.geoms if geom.contype or geom.conaffinity]
        default = soles[0].classname if soles else spec.default
        for sole in soles:
            spec.delete(sole)
        for index, capsule in enumerate(capsules, start=1):
            body.add_geom(
                default,
                name=f"{name}_sole{index}",
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=[capsule.radius, 0, 0],
                fromto=[*capsule.start, *capsule.end],
            )


def add_foot_counts(spec: mujoco.MjSpec) -> None:
    """Add a sensor of the number of its contacts to each contact sensor of a foot.

    MuJoCo reads a sensor with a force a physics step earlier than one that only counts. Counts of a foot and of all
    bodies are of the same moment so, and can be subtracted.

    Args:
        spec: description that is changed; a foot without a contact sensor is left as it is.
    """
    for name, count in FOOT_COUNTS.items():
        sensor = spec.sensor(name)
        if sensor is None or sensor.type != mujoco.mjtSensor.mjSENS_CONTACT:
            continue
        spec.add_sensor(
            name=count,
            type=sensor.type,
            objtype=sensor.objtype,
            objname=sensor.objname,
            reftype=sensor.reftype,
            refname=sensor.refname,
            intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND), 0, 1],
        )


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
