"""Captures to motions of the robot, and what became of them in figures."""

import functools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch

from plat.bounds import check_value
from plat.errors import ConfigError, MotionError
from plat.extras import importing
from plat.motions.checks.underside import Underside
from plat.motions.clip import MotionClip
from plat.motions.formats.axes import Up
from plat.motions.formats.clock import contradicting_name
from plat.motions.formats.common import FrameRate
from plat.motions.formats.foreign import refuse_foreign
from plat.motions.formats.units import Angles
from plat.motions.paths import find_files, listed_paths, read_twice
from plat.motions.retargeting.asf import read_amc
from plat.motions.retargeting.builtin import find_map
from plat.motions.retargeting.bvh import read_bvh
from plat.motions.retargeting.geometry import TRACKED, RobotGeometry
from plat.motions.retargeting.human import read_human
from plat.motions.retargeting.joint_file import holds_human_joints, read_joint_file
from plat.motions.retargeting.mocap import FPS, Mocap
from plat.motions.retargeting.options import SolverOptions
from plat.motions.retargeting.poselib import holds_poselib, read_poselib
from plat.motions.retargeting.skeletons import UNITS, SkeletonMap
from plat.pools import HelperPool, may_start_processes, told_if_killed
from plat.robots import G1, Robot
from plat.robots.kinematics import ForwardKinematics
from plat.rotations import quat_rotate

if TYPE_CHECKING:
    from plat.motions.retargeting.targets import Targets

__all__ = ["MOCAP_READERS", "TURNED", "Retargeted", "bvh_paths", "read_capture", "retarget", "retarget_all"]

MOCAP_READERS: dict[str, Callable[..., Mocap]] = {
    ".bvh": read_bvh,
    ".amc": read_amc,
    ".npz": read_joint_file,
    ".npy": read_poselib,
}
"""Reader of each file ending of human motion capture."""

# endings that files of robots have as well, and what tells those of humans
_HUMAN: dict[str, Callable[[Path], bool]] = {".npz": holds_human_joints, ".npy": holds_poselib}

TURNED = (".bvh", ".amc")
"""Endings of those that hold angles."""

# Files that a process must have to itself to be worth the seconds in which it starts.
_FILES_PER_WORKER = 16


@dataclass(frozen=True)
class Retargeted:
    """A motion of the robot and how well it follows the human's.

    Attributes:
        clip: the motion.
        error: mean distance of pelvis, knees, ankles, elbows and wrists from their targets, over bodies and frames
            (m). Bodies whose place follows from these, such as the torso, would only make it look better.
        penetration: deepest point of any part of the robot below the ground (m).
        floating: highest that the lowest point of a foot in stance is above the ground (m).
        slip: mean speed of the toes of feet in stance (m/s).
        seconds: that it took.
        shortfalls: what it could not do, a phrase each.
    """

    clip: MotionClip
    error: float
    penetration: float
    floating: float
    slip: float
    seconds: float
    shortfalls: tuple[str, ...] = ()


def bvh_paths(patterns: Sequence[str | Path], told: list[str] | None = None) -> list[Path]:
    """Return files of motion capture that paths, folders and globs name.

    Of the ``.npz`` and ``.npy`` in folders and globs those are taken that hold a human's motion.

    Args:
        patterns: paths, folders and globs.
        told: is given a line for each copy of a file that was left out, and for equal files that were not.

    Raises:
        MotionError: when there are none, or one of them names no file.
    """
    listed = listed_paths(patterns)
    equal: list[tuple[Path, Path]] | None = None if told is None else []
    found = find_files(patterns, MOCAP_READERS, told=told, twice=equal)
    if told is not None:
        told += map(read_twice, equal or ())
    paths = [path for path in found if path in listed or _may_be_human(path)]
    if found and not paths:
        raise MotionError(
            f"motion capture files: none of {len(found)} found, such as {str(found[0])!r}, holds a human's motion; "
            "those of a robot need no retargeting (plat motions convert)"
        )
    if not paths:
        raise MotionError("motion capture files: none given, expected files, folders or globs")
    return paths


def _may_be_human(path: Path) -> bool:
    """Return whether a file holds a human's motion, or stands in for one that is not there."""
    ending = path.suffix.lower()
    if ending not in _HUMAN:
        return True
    try:
        _refuse_foreign(path)
    except (MotionError, OSError):  # its error is told when it is read
        return True
    return _HUMAN[ending](path)


def _refuse_foreign(path: Path) -> None:
    with path.open("rb") as file:
        refuse_foreign(file.read(64), path.suffix.lower())


def read_capture(path: str | Path, fps: float | None = None, angles: Angles | None = None) -> Mocap:
    """Read a file of motion capture by its ending.

    Args:
        path: the file.
        fps: frames a second, where what it states is wrong.
        angles: unit of the angles of a ``.bvh`` or ``.amc``, the same way.

    Raises:
        MotionError: naming the file, when it cannot be read, holds no frames, or states a rate that no capture has.
    """
    path = Path(path)
    ending, where = path.suffix.lower(), _where(path)
    if ending not in MOCAP_READERS:
        raise MotionError(f"{where}: not a motion capture file, expected one of {', '.join(MOCAP_READERS)}")
    try:
        _refuse_foreign(path)
    except MotionError as error:
        raise MotionError(f"{where}: {error}") from None
    except OSError as error:
        raise MotionError(f"{where}: cannot be read ({error.strerror or error})") from error
    try:
        mocap = MOCAP_READERS[ending](path, fps, *([angles] if ending in TURNED else []))
    except MotionError:
        raise
    except Exception as error:  # whatever a parser stumbles over: the file is broken
        raise MotionError(f"{where}: not a readable {ending} file ({error})") from error
    if not len(mocap.positions):
        raise MotionError(f"{where}: 0 frames, expected at least 2")
    if fps is not None:
        return mocap
    if not FPS[0] <= mocap.fps <= FPS[1]:
        raise MotionError(
            f"{where}: it states {mocap.fps:.3g} frames a second, expected {FPS[0]:g} to {FPS[1]:g}; state it: "
            "plat motions convert --fps"
        )
    named = contradicting_name(path, [(mocap.fps, "it states")])
    told = [
        f"{mocap.fps:g} fps as it states, though the file name says {rate:g} (else: plat motions convert --fps)"
        for rate, _ in named[:1]
    ]
    return replace(mocap, notes=(*mocap.notes, *told))


def _where(path: Path) -> str:
    return f"{path.suffix[1:].upper() or 'Capture'} file {str(path)!r}"


def retarget(
    path: str | Path,
    skeleton: SkeletonMap | None = None,
    robot: Robot = G1,
    options: SolverOptions | None = None,
    fps: float | None = None,
    up: str | None = None,
    units: str | None = None,
    angles: Angles | None = None,
) -> Retargeted:
    """Turn the human motion of a capture, such as ``.bvh`` or ``.amc``, into one of the robot at its frame rate.

    Args:
        path: the file; the clip takes its name.
        skeleton: how to read it; by default the map that comes with plat and fits.
        robot: must have the bodies of :data:`TRACKED`.
        options: of inverse kinematics.
        fps: frames a second of the file, where what it states is wrong.
        up: axis that points up in the file, ``x``, ``y`` or ``z``, where it cannot be determined or is found wrong.
        units: of its lengths, one of :data:`~plat.motions.retargeting.skeletons.UNITS`, the same way.
        angles: unit of the angles of a ``.bvh`` or ``.amc``, the same way.

    Raises:
        MotionError: naming file and line or field, when it cannot be read or does not fit the map, or what is stated
            of it is none of these values.
    """
    with importing("retarget", "retargeting needs", MotionError):
        from plat.motions.retargeting.floor import above_floor
        from plat.motions.retargeting.inverse_kinematics import solve
        from plat.motions.retargeting.planted_feet import lift
        from plat.motions.retargeting.shortfalls import shortfalls
        from plat.motions.retargeting.targets import robot_targets
    try:
        check_value("fps", fps, FrameRate | None)
        check_value("up", up, Up | None)
        check_value("units", units, Literal[tuple(UNITS)] | None)
        check_value("angles", angles, Angles | None)
    except ConfigError as error:
        raise MotionError(f"stated of {str(path)!r}: {error}") from None
    began = time.perf_counter()
    where = _where(Path(path))
    mocap = read_capture(path, fps, angles)
    if len(mocap.positions) < 2:
        raise MotionError(f"{where}: 1 frame, expected at least 2")
    notes = []
    if skeleton is None:
        skeleton = find_map(mocap, where)
        notes.append(f"map {skeleton.name}")
    geometry = RobotGeometry.of(robot)
    human = read_human(mocap, skeleton, where, up, units)
    targets = robot_targets(human, skeleton, geometry, mocap.fps)
    raised = above_floor(targets, robot)
    options = options or SolverOptions()
    qpos = solve(targets, robot, mocap.fps, options)
    underside = Underside(robot)
    heights = underside.heights(qpos)
    lifted = lift(-heights.min(1), mocap.fps)
    qpos[:, 2] += lifted
    clip = MotionClip(Path(path).stem, qpos, mocap.fps, (*notes, *human.notes)).checked(robot)
    result = _measured(clip, targets, robot, geometry, began)
    told = shortfalls(clip, targets, robot, options, raised, lifted, heights, underside.bodies)
    deepest = float(max(0.0, -(heights + lifted[:, None]).min()))
    return replace(
        result,
        clip=replace(clip, notes=(*clip.notes, *told)),
        penetration=deepest,
        shortfalls=told,
        seconds=time.perf_counter() - began,
    )


def retarget_all(
    paths: Sequence[Path],
    skeleton: SkeletonMap | None = None,
    robot: Robot = G1,
    options: SolverOptions | None = None,
    workers: int = 1,
    fps: float | None = None,
    up: str | None = None,
    units: str | None = None,
    angles: Angles | None = None,
) -> Iterator[Retargeted | MotionError]:
    """Retarget many files as :func:`retarget` does, in their order; a file that cannot be used yields its error.

    Args:
        paths: files.
        skeleton, robot, options: see :func:`retarget`.
        workers: processes, at most; few files are done in this one.
        fps, up, units, angles: of the files; see :func:`retarget`.
    """
    work = functools.partial(
        _attempt, skeleton=skeleton, robot=robot, options=options, fps=fps, up=up, units=units, angles=angles
    )
    workers = min(workers, len(paths) // _FILES_PER_WORKER)
    if workers < 2 or not may_start_processes():
        yield from map(work, paths)
        return
    with told_if_killed(), HelperPool(workers, torch.set_num_threads, 1) as pool:
        yield from pool.map(work, paths, chunksize=4)


def _attempt(
    path: Path,
    skeleton: SkeletonMap | None,
    robot: Robot,
    options: SolverOptions | None,
    fps: float | None,
    up: str | None,
    units: str | None,
    angles: Angles | None,
) -> Retargeted | MotionError:
    try:
        return retarget(path, skeleton, robot, options, fps, up, units, angles)
    except MotionError as error:
        return error
    except Exception as error:  # one file does not end the work on all
        return MotionError(f"{_where(path)}: cannot be retargeted ({type(error).__name__}: {str(error)[:200]})")


def _measured(clip: MotionClip, targets: "Targets", robot: Robot, geometry: RobotGeometry, began: float) -> Retargeted:
    reached, _ = _bodies(clip.qpos, robot, tuple(TRACKED[role] for role in targets.positions))
    wanted = np.stack(list(targets.positions.values()), 1)
    soles = _soles(clip.qpos, robot, geometry)
    stance = np.stack([targets.contact[role] > 0.9 for role in ("left_ankle", "right_ankle")], 1)
    toes = soles[:, :, geometry.sole[:, 0] == geometry.sole[:, 0].max(), :2].mean(2)
    speed = np.linalg.norm(np.diff(toes, axis=0), axis=-1) * clip.fps
    staying = stance[1:] & stance[:-1]
    return Retargeted(
        clip=clip,
        error=float(np.linalg.norm(reached - wanted, axis=-1).mean()),
        penetration=float(max(0.0, -soles[..., 2].min())),
        floating=float(soles[..., 2].min(2)[stance].max(initial=0.0)),
        slip=float(speed[staying].mean()) if staying.any() else 0.0,
        seconds=time.perf_counter() - began,
    )


def _bodies(qpos: np.ndarray, robot: Robot, names: tuple[str, ...]) -> tuple[np.ndarray, torch.Tensor]:
    poses = torch.from_numpy(qpos).float()
    positions, quats = ForwardKinematics(robot, names)(poses[:, :3], poses[:, 3:7], poses[:, 7:])
    return positions.numpy(), quats


def _soles(qpos: np.ndarray, robot: Robot, geometry: RobotGeometry) -> np.ndarray:
    """Contact points of left and right foot in the world, ``[T, 2, P, 3]``; they lie alike in both feet."""
    positions, quats = _bodies(qpos, robot, robot.feet)
    points = torch.from_numpy(geometry.sole).float()
    return positions[:, :, None] + quat_rotate(quats[:, :, None], points).numpy()
