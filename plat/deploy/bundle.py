"""Metadata of an exported policy: the content of ``bundle.json``, see ``docs/deploy.md``."""

from __future__ import annotations

import json
import math
import re
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plat.deploy.description import Body, Foot, RobotDescription
from plat.deploy.observation import ObservationBuilder, ObservationTerm, observation_terms
from plat.errors import BundleError
from plat.json_file import parse_json, short, version_fault
from plat.rotations_np import UNIT_TOLERANCE
from plat.spec.observation import OPTIONAL_GROUPS
from plat.spec.timing import LONGEST, LONGEST_STEP, SHORTEST_STEP, Timing

__all__ = [
    "HASH_FIELD",
    "INPUT",
    "METADATA_KEY",
    "OUTPUT",
    "Bundle",
    "BundleScore",
    "PolicyFacts",
    "TrainingFacts",
    "readable_json",
]

_FORMAT, _VERSION = "plat-bundle", 1
_TAU = "control steps left until the keyframe / max_steps"
METADATA_KEY = _FORMAT
"""Under this name the same JSON is in the ONNX file's ``metadata_props``."""
HASH_FIELD = "network_sha256"
"""Field of ``bundle.json`` that the copy inside the network lacks."""
INPUT = "observation"
"""The network's input ``[batch, F]``, float32."""
OUTPUT = "joint_position_target"
"""The network's output ``[batch, J]`` (rad), float32."""


@dataclass(frozen=True)
class PolicyFacts:
    """Kind and architecture of a policy."""

    kind: str
    """kind, as in a run's ``config.json``"""
    latent_size: int | None
    """size of the latent z; None for a policy without one"""
    residual_alpha: float | None
    """factor alpha on the residual; None for a policy without one"""


@dataclass(frozen=True)
class TrainingFacts:
    """Provenance of a policy: run, recipe and versions."""

    run: str
    """name of the run directory"""
    recipe: str | None
    """script that made the run"""
    plat: str | None
    """version of plat that it was trained with"""
    torch: str | None
    """version of torch"""
    commit: str | None
    """commit of plat's sources"""


@dataclass(frozen=True)
class BundleScore:
    """Metric of ``plat evaluate`` with its 95 % bootstrap interval over motions."""

    horizon: str
    metric: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Bundle:
    """Bundle metadata: robot, timing, observation layout, provenance and scores.

    Args:
        robot: the robot that the policy drives.
        timing: control step, longest command and arrival window that it was trained with.
        policy: what kind of policy it is.
        training: where it comes from.
        scores: None when it has not been scored.
        network_sha256: SHA-256 of the network's file, in hexadecimal; None in the copy inside that file, and in
            bundles of plat 0.2 and before.
        also: groups that the policy observes beside robot, goal and command: ``"parts"``, ``"clock"``.
    """

    robot: RobotDescription
    timing: Timing
    policy: PolicyFacts
    training: TrainingFacts
    scores: tuple[BundleScore, ...] | None
    network_sha256: str | None = None
    also: tuple[str, ...] = ()

    @property
    def max_steps(self) -> int:
        """Return ``Delta_max``, the longest command in control steps."""
        return self.timing.max_steps

    @property
    def terms(self) -> tuple[ObservationTerm, ...]:
        """Return the layout of an observation: its terms in order."""
        return observation_terms(len(self.robot.joint_names), len(self.robot.keypoints), self.also)

    def observation_builder(self) -> ObservationBuilder:
        """Return the builder of the policy's observations."""
        return ObservationBuilder(self.robot, self.timing.max_steps, self.also, self.timing.window)

    def to_json(self) -> str:
        """Return the content of ``bundle.json``. Numbers survive a round trip exactly."""
        robot = asdict(self.robot)
        control_dt = robot.pop("control_dt")
        content = {
            "format": _FORMAT,
            "version": _VERSION,
            "robot": {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in robot.items()},
            "quaternion_order": "wxyz",
            "control_dt": control_dt,
            "command": {"max_steps": self.timing.max_steps, "window": self.timing.window, "tau": _TAU},
            "observation": {"name": INPUT, "terms": [asdict(term) for term in self.terms]},
            "action": {"name": OUTPUT, "unit": "rad"},
            "policy": asdict(self.policy),
            "training": asdict(self.training),
            "scores": None if self.scores is None else [asdict(score) for score in self.scores],
        }
        if self.network_sha256 is not None:
            content[HASH_FIELD] = self.network_sha256
        return readable_json(content)

    @classmethod
    def from_json(cls, text: str, where: str) -> Bundle:
        """Read what :meth:`to_json` wrote.

        Args:
            text: JSON.
            where: name of the source in error messages.

        Raises:
            BundleError: naming the field that is missing, broken, or of another version of the format.
        """
        return cls.from_content(
            parse_json(text.encode(errors="surrogatepass"), BundleError, where, constants=True), where
        )

    @classmethod
    def from_content(cls, values: Any, where: str) -> Bundle:
        """Read the object that :meth:`to_json` wrote as text; see :meth:`from_json`."""
        content = _Object(values, "", where)
        content.expect("format", _FORMAT)
        if fault := version_fault(content.content.get("version"), _VERSION):
            raise content.fault("version", fault)
        content.expect("quaternion_order", "wxyz")
        content.object("action").expect("name", OUTPUT)
        command = content.object("command")
        robot = _robot(content)
        bundle = cls(
            robot=robot,
            timing=_timing(command, robot.control_dt),
            policy=_policy(content.object("policy")),
            training=_training(content.object("training")),
            scores=None if content.content.get("scores") is None else tuple(map(_score, content.objects("scores"))),
            network_sha256=content.optional(HASH_FIELD, str),
            also=_also(content.object("observation")),
        )
        _check_terms(content.object("observation"), bundle.terms)
        return bundle


def readable_json(content: Any) -> str:
    """Return JSON with a field a line, and each list of numbers or names on one line.

    >>> print(readable_json({"gains": [1.5, 2.0]}), end="")
    {
     "gains": [1.5, 2.0]
    }
    """
    text = json.dumps(content, indent=1, allow_nan=False)
    # a text holds no line break, so what follows "[" and a line break is never inside one
    return re.sub(r"\[\n([^][{}]*)\n\s*\]", _on_one_line, text) + "\n"


def _on_one_line(entries: re.Match[str]) -> str:
    return "[" + re.sub(r"\s*\n\s*", " ", entries[1].strip()) + "]"


def _timing(command: _Object, control_dt: float) -> Timing:
    steps = {"max_steps": command.value("max_steps", int)}
    if "window" in command.content:  # bundles of version 0.1 do not say: it was 3 for all of them
        steps["window"] = command.value("window", int)
    for field, count in steps.items():
        if not 1 <= count <= LONGEST:
            raise command.fault(field, f"is {short(count)}, expected at least 1 and at most {LONGEST}")
    return Timing(control_dt, **steps)


def _robot(content: _Object) -> RobotDescription:
    robot = content.object("robot")
    joints = len(joint_names := robot.names("joint_names"))
    control_dt = content.value("control_dt", float)
    if not SHORTEST_STEP <= control_dt <= LONGEST_STEP:
        expected = f"expected {SHORTEST_STEP:g} to {LONGEST_STEP:g} seconds"
        raise content.fault("control_dt", f"is {control_dt}, {expected}")
    bodies = tuple(_body(entry, index, joints) for index, entry in enumerate(robot.objects("bodies")))
    keypoints = robot.names("keypoints")
    unknown = sorted(set(keypoints) - {body.name for body in bodies})
    if unknown:
        raise robot.fault("keypoints", f"{unknown[0]!r} is not the name of a body")
    if bodies[0].name != keypoints[0]:
        raise robot.fault("keypoints", f"the first is {keypoints[0]!r}, expected the root {bodies[0].name!r}")
    joint_range = robot.numbers("joint_range", joints, 2)
    if (reversed_joints := np.flatnonzero(joint_range[:, 0] > joint_range[:, 1])).size:
        index = int(reversed_joints[0])
        low, high = joint_range[index]
        raise robot.fault(f"joint_range[{index}]", f"from {low:g} to {high:g}, expected lower before upper limit")
    root_height, mass = robot.value("root_height", float), robot.optional("mass", float)
    for field, value, unit in (("root_height", root_height, "meters"), ("mass", mass, "kilograms")):
        if value is not None and value <= 0:
            raise robot.fault(field, f"is {value:g}, expected a positive number of {unit}")
    return RobotDescription(
        name=robot.value("name", str),
        joint_names=joint_names,
        root_height=root_height,
        control_dt=control_dt,
        keypoints=keypoints,
        bodies=bodies,
        default_joint_pos=robot.numbers("default_joint_pos", joints),
        joint_range=joint_range,
        stiffness=robot.at_least_zero("stiffness", joints),
        damping=robot.at_least_zero("damping", joints),
        effort_limit=robot.at_least_zero("effort_limit", joints),
        # actions are computed back from targets, by division
        action_scale=robot.at_least_zero("action_scale", joints, or_zero=False),
        feet=_feet(robot, {body.name for body in bodies}),
        mass=mass,  # bundles of version 0.2 and before do not say
    )


def _feet(robot: _Object, bodies: set[str]) -> tuple[Foot, ...]:
    if not robot.content.get("feet"):  # bundles of version 0.2 and before do not say
        return ()
    feet = []
    for entry in robot.objects("feet"):
        if (name := entry.value("body", str)) not in bodies:
            raise entry.fault("body", f"{name!r} is not the name of a body")
        points = entry.numbers("soles", len(entry.value("soles", list)), 3)
        feet.append(Foot(name, tuple((x, y, z) for x, y, z in points.tolist())))
    return tuple(feet)


def _body(entry: _Object, index: int, joints: int) -> Body:
    parent, joint = entry.value("parent", int), entry.value("joint", int)
    if (parent != -1) if index == 0 else not 0 <= parent < index:
        raise entry.fault("parent", f"is {parent}, expected the index of an earlier body, and -1 for the first alone")
    if not -1 <= joint < joints:
        raise entry.fault("joint", f"is {joint}, expected the index of a joint or -1")
    x, y, z = entry.numbers("pos", 3).tolist()
    qw, qx, qy, qz = entry.direction("quat", 4).tolist()
    ax, ay, az = (entry.numbers("axis", 3) if joint < 0 else entry.direction("axis", 3)).tolist()
    return Body(entry.value("name", str), parent, joint, (ax, ay, az), (x, y, z), (qw, qx, qy, qz))


def _policy(entry: _Object) -> PolicyFacts:
    return PolicyFacts(
        entry.value("kind", str),
        entry.optional("latent_size", int),
        entry.optional("residual_alpha", float),
    )


def _training(entry: _Object) -> TrainingFacts:
    made_with = (entry.optional(name, str) for name in ("recipe", "plat", "torch", "commit"))
    return TrainingFacts(entry.value("run", str), *made_with)


def _score(entry: _Object) -> BundleScore:
    figures = (entry.value(name, float) for name in ("value", "low", "high"))
    return BundleScore(entry.value("horizon", str), entry.value("metric", str), *figures)


def _also(observation: _Object) -> tuple[str, ...]:
    """Return the optional groups that the terms of an observation are of."""
    groups = {entry.value("name", str).split(".")[0] for entry in observation.objects("terms")}
    return tuple(group for group in OPTIONAL_GROUPS if group in groups)


def _check_terms(observation: _Object, known: tuple[ObservationTerm, ...]) -> None:
    observation.expect("name", INPUT)
    terms = [
        (entry.value("name", str), entry.value("start", int), entry.value("stop", int))
        for entry in observation.objects("terms")
    ]
    expected = [(term.name, term.start, term.stop) for term in known]
    if terms != expected:
        different = next((pair for pair in zip(terms, expected, strict=False) if pair[0] != pair[1]), None)
        found, right = different or (f"{len(terms)} of them", f"{len(expected)}")
        raise observation.fault("terms", f"{found}, expected {right}: this version of plat builds no other observation")


class _Object:
    """Object of a JSON file, with type-checked access to its fields."""

    def __init__(self, content: Any, path: str, where: str):
        self._path, self._where = path, where
        if not isinstance(content, dict):
            raise BundleError(f"{where}: {path or 'it'} is a {type(content).__name__}, expected an object")
        self.content = content

    def _name(self, field: str) -> str:
        return f"{self._path}.{field}" if self._path else field

    def fault(self, field: str, what: str) -> BundleError:
        return BundleError(f"{self._where}: {self._name(field)}: {what}")

    def expect(self, field: str, expected: str | int) -> None:
        found = self.content.get(field)
        if type(found) is not type(expected) or found != expected:
            raise self.fault(field, f"is {short(found)}, expected {expected!r}")

    def value(self, field: str, kind: type) -> Any:
        if field not in self.content:
            raise self.fault(field, "is missing")
        value = self.content[field]
        if kind is float and type(value) is int and abs(value) < 2**53:
            value = float(value)
        fits = type(value) is kind
        if not fits or (kind is float and not math.isfinite(value)):
            raise self.fault(field, f"is {short(value)}, expected {_KINDS[kind]}")
        return value

    def optional(self, field: str, kind: type) -> Any:
        return None if self.content.get(field) is None else self.value(field, kind)

    def object(self, field: str) -> _Object:
        return _Object(self.content.get(field), self._name(field), self._where)

    def objects(self, field: str) -> list[_Object]:
        entries = self.value(field, list)
        if not entries:
            raise self.fault(field, "is empty")
        return [_Object(entry, f"{self._name(field)}[{index}]", self._where) for index, entry in enumerate(entries)]

    def names(self, field: str) -> tuple[str, ...]:
        names = self.value(field, list)
        if not names or not all(isinstance(name, str) for name in names) or len(set(names)) != len(names):
            raise self.fault(field, "expected a list of different names")
        return tuple(names)

    def numbers(self, field: str, *shape: int) -> NDArray[np.float64]:
        listed = self.value(field, list)
        try:
            values = np.array(listed, dtype=np.float64)
            # NumPy takes texts and truth values for numbers
            if not all(type(number) in (int, float) for number in np.array(listed, dtype=object).ravel()):
                raise TypeError
        except (TypeError, ValueError, OverflowError):
            raise self.fault(field, "expected numbers only") from None
        if values.shape != shape:
            raise self.fault(field, f"has shape {values.shape}, expected {shape}")
        if not np.isfinite(values).all():
            raise self.fault(field, "expected finite numbers")
        return values

    def at_least_zero(self, field: str, size: int, *, or_zero: bool = True) -> NDArray[np.float64]:
        values = self.numbers(field, size)
        wrong = np.flatnonzero(values < 0 if or_zero else values <= 0)
        if wrong.size:
            expected = "at least 0" if or_zero else "more than 0"
            raise self.fault(f"{field}[{wrong[0]}]", f"is {values[wrong[0]]:g}, expected {expected}")
        return values

    def direction(self, field: str, size: int) -> NDArray[np.float64]:
        values = self.numbers(field, size)
        length = float(np.linalg.norm(values))
        if abs(length - 1.0) > UNIT_TOLERANCE:
            raise self.fault(field, f"has length {length:.4g}, expected 1")
        return values


_KINDS = {str: "a text", int: "a whole number", float: "a finite number", list: "a list"}
