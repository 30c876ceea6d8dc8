"""Archives of trackers: joints, and poses of bodies in the world that say how to read them."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from plat.errors import MotionError
from plat.json_file import short
from plat.motions.clip import MotionClip
from plat.motions.formats.common import MotionFile, QuatOrder, ReadOptions, arrange_joints, make_clip, strings
from plat.motions.formats.joint_columns import robot_columns
from plat.motions.formats.joint_orders import in_robot_order, usual_orders
from plat.motions.formats.quaternion_order import settle_joint_order, settle_quat_order
from plat.motions.formats.spellings import match_joint
from plat.motions.formats.units import angles_in_radians
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot

__all__ = ["read_tracker"]

# Bodies that a tracker's file records as they are (m): its robot may differ from ours by some millimeters.
_SAME_PLACE = 0.01
# Links of another description of the robot put bodies elsewhere by less than this (m); what is beyond is another pose.
_OTHER_LINKS, _OTHER_POSE = 0.02, 0.05
_FARTHEST = 1e6
_CHECKED_FRAMES = 50
# Named bodies that a motion is checked against, at least.
_ENOUGH = 5
_ORDERS: tuple[QuatOrder, ...] = ("wxyz", "xyzw")


@dataclass(frozen=True)
class Recorded:
    """Places of bodies in the world that a file records, to check a motion against.

    Attributes:
        places: of the bodies ``[T, B, 3]``.
        bodies: of the robot: those of these places, or its keypoints.
        kinematics: to these bodies.
        named: whether the places are those of these bodies, and not of any.
    """

    places: torch.Tensor
    bodies: tuple[str, ...]
    kinematics: ForwardKinematics
    named: bool

    @classmethod
    def of(cls, bodies: np.ndarray, arrays: dict[str, np.ndarray], robot: Robot) -> "Recorded":
        """Return what a file records; bodies are matched by name where it names enough of them."""
        places = torch.from_numpy(bodies.astype(np.float64))
        names = strings(arrays["body_names"], "body_names") if "body_names" in arrays else []
        model = robot.shared_model
        known = {model.body(body).name.removesuffix("_link"): model.body(body).name for body in range(1, model.nbody)}
        found = {name.removesuffix("_link"): column for column, name in enumerate(names)}
        both = [name for name in found if name in known]
        if len(names) != bodies.shape[1] or len(both) < _ENOUGH:
            return cls(places, robot.keypoints, ForwardKinematics(robot, robot.keypoints), False)
        matched = tuple(known[name] for name in both)
        return cls(places[:, [found[name] for name in both]], matched, ForwardKinematics(robot, matched), True)

    def distance(self, root_pos: np.ndarray, root_quat: np.ndarray, joints: np.ndarray, frames: np.ndarray) -> float:
        """Return the largest mean distance of a body from where the motion puts it (m)."""
        parts = [torch.from_numpy(part.astype(np.float64)) for part in (root_pos, root_quat, joints)]
        parts[1] = parts[1] / parts[1].norm(dim=-1, keepdim=True).clamp_min(1e-9)
        pos_w, _ = self.kinematics(*parts)
        recorded = self.places[frames]
        if self.named:
            return float((pos_w - recorded).norm(dim=-1).mean(0).amax())
        return float(torch.cdist(pos_w, recorded).amin(-1).mean(0).amax())

    def contradictions(self, qpos: np.ndarray, whole: bool) -> list[str]:
        """Return what named bodies say against a motion: against its joints, and against its root.

        Args:
            qpos: the motion ``[T, 7 + J]``.
            whole: whether the file has all joints of the robot.

        Raises:
            MotionError: where joints of a whole robot lead to other poses than the recorded ones.
        """
        if not self.named:
            return []
        frames = _some(len(qpos))
        if not bool((self.places[frames].abs() < _FARTHEST).all()):
            return ["places in 'body_pos_w' that are none"]
        pos_w, _ = self.kinematics(*torch.from_numpy(qpos[frames]).double().split((3, 4, qpos.shape[1] - 7), -1))
        posed = _aligned(pos_w, self.places[frames])  # as no root puts them nearer
        off = (posed - self.places[frames]).norm(dim=-1).mean(0)
        told = f"joints as named put {self.bodies[int(off.argmax())]!r} {float(off.amax()):.2f} m from 'body_pos_w'"
        if whole and off.amax() > _OTHER_POSE:
            raise MotionError(f"{told}; correct 'joint_names', or leave 'body_pos_w' out")
        notes = [told] if off.amax() > _OTHER_LINKS else []
        moved = float((posed - pos_w).norm(dim=-1).mean())
        return notes + ([f"the root puts bodies {moved:.2f} m from 'body_pos_w'"] if moved > _OTHER_LINKS else [])


def read_tracker(
    path: Path, arrays: dict[str, np.ndarray], fps: float, names: list[str] | None, options: ReadOptions
) -> MotionFile:
    """Read ``joint_pos`` with the joints, or with root position, quaternion and joints, and the root beside it.

    Where the file records bodies in the world, the orders of quaternion and joints are those that lead to them. Names
    that do not, and no other order either, are refused.

    Raises:
        MotionError: naming the array that is missing, or what does not fit.
    """
    robot = options.robot
    root_pos, root_quat, joint_pos, fields = _root(arrays, robot, names)
    of_joints = "joint_pos" if joint_pos is arrays["joint_pos"] else "joint_pos[:, 7:]"
    bodies = arrays.get("body_pos_w")
    beside: list[str] = []
    if names is not None:
        columns, names, left_out = robot_columns(names, joint_pos.shape[1], robot)
        joint_pos = joint_pos[:, columns]
        beside = [f"joints left out: {', '.join(left_out[:3])}"] if left_out else []
    else:
        columns = list(range(joint_pos.shape[1]))
    for field, part in zip(fields, (root_pos, root_quat), strict=True):
        _check_finite(part, field)
    _check_finite(joint_pos, of_joints, columns)
    stated = names
    usable = bodies is not None and bodies.ndim == 3 and len(bodies) == len(joint_pos) and bodies.shape[2] == 3
    notes: list[str] = []
    fits = False
    order: QuatOrder = options.quat_order or ("xyzw" if _scalar_last(arrays) else "wxyz")
    recorded = Recorded.of(bodies, arrays, robot) if usable and bodies is not None else None
    if recorded is not None:
        roots = [(root_pos, root_quat)]
        if fields[0].startswith("body_pos_w") and "body_names" not in arrays and bodies is not None:
            roots += zip(bodies.swapaxes(0, 1), arrays["body_quat_w"].swapaxes(0, 1), strict=True)
        (root_pos, root_quat), (order, names, notes, fits) = _fit_root(
            recorded, roots, joint_pos, order, stated, options
        )
    elif names is None and "root_pos" in arrays and joint_pos.shape[1] == robot.num_joints:
        # fields as of a pickle of GMR: the robot's order, unless the motion shows another
        def read(joints: np.ndarray) -> np.ndarray:
            return make_clip(path.stem, root_pos, root_quat, joints, fps, options, order, fields).qpos

        listed, notes = settle_joint_order(joint_pos.astype(np.float64), read, options, None)
        joint_pos, names = in_robot_order(joint_pos, listed, robot), list(robot.joint_names)
    elif names is None:
        raise MotionError(
            f"no array 'joint_names' and no usable 'body_pos_w' to find the order of its {joint_pos.shape[1]} joints "
            f"by; add 'joint_names', {joint_pos.shape[1]} names in the order of the columns of 'joint_pos'"
        )
    arranged, more = arrange_joints(joint_pos, names, robot, "joint_pos")

    def as_clip(order: QuatOrder) -> MotionClip:
        return make_clip(path.stem, root_pos, root_quat, arranged, fps, options, order, fields)

    if not fits and options.quat_order is None:
        order, doubts = settle_quat_order(lambda order: as_clip(order).qpos, fps, options.soles, order)
        notes += doubts
    clip = as_clip(order)
    # places in other units or axes than the clip's say nothing here
    if recorded is not None and not fits and np.allclose(clip.qpos[:, :3], root_pos, atol=1e-4):
        notes += recorded.contradictions(clip.qpos, len(names) == robot.num_joints)
    return MotionFile(path, "tracker npz", [clip], (f"quaternion {order}", *notes, *more, *beside))


def _root(
    arrays: dict[str, np.ndarray], robot: Robot, names: list[str] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, str]]:
    """Return root position, root quaternion, joints, and what the file calls the first two."""
    joint_pos = arrays["joint_pos"]
    if joint_pos.ndim != 2:
        raise MotionError(f"'joint_pos' has shape {joint_pos.shape}, expected (frames, joints)")
    whole = 7 + (len(names) if names is not None else robot.num_joints)
    if joint_pos.shape[1] == whole:
        fields = ("joint_pos[:, :3]", "joint_pos[:, 3:7]")
        return joint_pos[:, :3], joint_pos[:, 3:7], joint_pos[:, 7:], fields
    if "root_pos" in arrays and "root_quat" in arrays:
        return arrays["root_pos"], arrays["root_quat"], joint_pos, ("root_pos", "root_quat")
    for name, width in (("body_pos_w", 3), ("body_quat_w", 4)):
        if name not in arrays:
            raise MotionError(
                f"no array {name!r} with the root in it, and no 'root_pos' with 'root_quat', because 'joint_pos' has "
                f"{joint_pos.shape[1]} columns and not {whole}; it has {', '.join(map(short, list(arrays)[:12]))}"
            )
        shape = arrays[name].shape
        if len(shape) != 3 or shape[0] != len(joint_pos) or shape[1] < 1 or shape[2] != width:
            raise MotionError(
                f"array {name!r} has shape {shape}, expected ({len(joint_pos)}, bodies, {width}) with the root in "
                f"it, because 'joint_pos' has {joint_pos.shape[1]} columns and not {whole}"
            )
    root = _root_index(arrays, robot)
    fields = (f"body_pos_w[:, {root}]", f"body_quat_w[:, {root}]")
    return arrays["body_pos_w"][:, root], arrays["body_quat_w"][:, root], joint_pos, fields


def _check_finite(values: np.ndarray, field: str, columns: Sequence[int] | None = None) -> None:
    """Raise for a number that is not finite: no order of joints leads to recorded bodies with it.

    Args:
        values: of an array, or of some of its columns.
        field: what the file calls the array.
        columns: of the array that these are.

    Raises:
        MotionError: naming the first one.
    """
    if values.ndim != 2 or values.dtype.kind != "f" or (finite := np.isfinite(values)).all():
        return  # the clip's own reading says what else is wrong
    frame, column = np.argwhere(~finite)[0]
    where = f"{field!r}[{frame}, {column if columns is None else columns[column]}]"
    raise MotionError(f"{where} is {values[frame, column]}, expected a finite number")


def _root_index(arrays: dict[str, np.ndarray], robot: Robot) -> int:
    if "body_names" not in arrays:
        places = arrays["body_pos_w"]
        # MuJoCo's bodies begin with the world, which never moves
        return int(places.shape[1] > 1 and not places[:, 0].any() and bool(places[:, 1].any()))
    bodies = [name.removesuffix("_link") for name in strings(arrays["body_names"], "body_names")]
    root = robot.keypoints[0].removesuffix("_link")
    if root not in bodies:
        raise MotionError(f"'body_names' lacks {robot.keypoints[0]!r}, the root of {robot.name!r}")
    return bodies.index(root)


def _aligned(points: torch.Tensor, to: torch.Tensor) -> torch.Tensor:
    """Return points ``[F, B, 3]`` moved and turned as a whole in each frame, so that they are nearest to others."""
    center, goal = points.mean(1, keepdim=True), to.mean(1, keepdim=True)
    left, _, right = torch.linalg.svd((points - center).mT @ (to - goal))
    left[..., -1] *= torch.linalg.det(left @ right)[:, None].sign()  # no mirror image
    return goal + (points - center) @ (left @ right)


def _some(frames: int) -> np.ndarray:
    return np.linspace(0, frames - 1, min(frames, _CHECKED_FRAMES)).round().astype(int)


def _scalar_last(arrays: dict[str, np.ndarray]) -> bool:
    first = arrays.get("scalar_first")
    return first is not None and first.size == 1 and not bool(first.item())


def _fit_root(
    recorded: "Recorded",
    roots: Sequence[tuple[np.ndarray, np.ndarray]],
    joint_pos: np.ndarray,
    order: QuatOrder,
    names: list[str] | None,
    options: ReadOptions,
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[QuatOrder, list[str], list[str], bool]]:
    """Return the root that leads to the recorded bodies, and what :func:`_fit` makes of it; else of the first one.

    Args:
        recorded: bodies in the world.
        roots: what may be the root: the usual one, and where no names tell it all bodies, each with its quaternion.
        joint_pos: angles ``[T, n]``.
        order: of quaternions, as stated.
        names: of the joints, where the file has them.
        options: what the user says.
    """
    for number, root in enumerate(roots):
        with contextlib.suppress(MotionError):
            order_of, joints, notes, fits = _fit(recorded, *root, joint_pos, order, names, options)
            if fits:
                told = [f"body {number - 1} is the root: it leads to the others"] if number else []
                return root, (order_of, joints, [*notes, *told], fits)
    return roots[0], _fit(recorded, *roots[0], joint_pos, order, names, options)


def _fit(
    recorded: "Recorded",
    root_pos: np.ndarray,
    root_quat: np.ndarray,
    joint_pos: np.ndarray,
    order: QuatOrder,
    names: list[str] | None,
    options: ReadOptions,
) -> tuple[QuatOrder, list[str], list[str], bool]:
    """Return the orders of quaternion and joints that lead to the recorded bodies, notes, and whether any do.

    Files of Isaac Lab number joints breadth first, those of MuJoCo depth first, and few say so. With the right
    orders forward kinematics leads to the recorded bodies, so names and order that a file states are tried as well.
    """
    robot = options.robot
    candidates: dict[str, list[str]] = {}
    if names is not None:
        candidates["as named"] = names
    if joint_pos.shape[1] == robot.num_joints:
        candidates |= {"depth first": list(robot.joint_names), **usual_orders(robot)}
    if not candidates:
        raise MotionError(
            f"no array 'joint_names', and {joint_pos.shape[1]} joints are no robot's whole number; add 'joint_names', "
            f"{joint_pos.shape[1]} names in the order of the columns of 'joint_pos'"
        )
    frames = _some(len(joint_pos))
    orders = _ORDERS if options.quat_order is None else (options.quat_order,)
    errors: dict[tuple[str, QuatOrder], float] = {}
    for label, listed in candidates.items():
        if label != "as named" or all(match_joint(name, robot) for name in listed):
            arranged, _ = arrange_joints(joint_pos[frames], listed, robot, "joint_pos")
            with contextlib.suppress(MotionError):  # the clip's own reading says it
                arranged = angles_in_radians(arranged, robot).values
            for which in orders:
                quat = root_quat[frames][:, [3, 0, 1, 2]] if which == "xyzw" else root_quat[frames]
                errors[label, which] = recorded.distance(root_pos[frames], quat, arranged, frames)
    fitting = [key for key, error in errors.items() if error < _SAME_PLACE]
    if names is not None:
        if ("as named", order) in fitting or not fitting:
            return order, names, [], bool(fitting)
        label, found = min(fitting, key=lambda key: (key[0] != "as named", key[1] != order))
        told = f"the bodies fit quaternion {found} and joints {label if label == 'as named' else f'numbered {label}'}"
        return found, candidates[label], [told], True
    labels = {label for label, _ in fitting}
    if not labels and not recorded.places[frames].isfinite().all():
        raise MotionError("'body_pos_w' has places that are not finite, expected numbers, or 'joint_names' beside them")
    if len(labels) != 1:
        found_any = "more than one usual order of joints fits" if labels else "no usual order of joints fits"
        raise MotionError(
            f"no array 'joint_names', and {found_any} its 'body_pos_w'; add 'joint_names', {joint_pos.shape[1]} names "
            "in the order of the columns of 'joint_pos'"
        )
    (label,) = labels
    found = order if (label, order) in fitting else next(which for _, which in fitting)
    told = f"no joint names, the bodies fit joints numbered {label}"
    return found, candidates[label], [told, *([] if found == order else [f"the bodies fit quaternion {found}"])], True
