"""Files of other kinds, named as such."""

from collections.abc import Collection

import numpy as np

from plat.errors import MotionError

__all__ = ["refuse_bare_joints", "refuse_foreign", "refuse_human_body", "refuse_old_arrays"]

_BODY_POSES = ("poses", "pose_body", "pose_aa", "body_pose", "smpl_poses", "full_pose")
_BODY_SHAPES = ("betas", "beta", "v_template", "shape_est_betas")
# what loco-mujoco called the root in its first data sets, an array for each coordinate
_OLD_ROOT = ("q_pelvis_tx", "q_pelvis_tilt")
_GZIP = b"\x1f\x8b"
_PICKLES = (".pkl", ".pickle", ".joblib")
_MAGIC = {
    b"version https://git-lfs": "a Git LFS pointer and not the file itself: run 'git lfs pull' where it comes from",
    b"version https://hawser": "a Git LFS pointer and not the file itself: run 'git lfs pull' where it comes from",
    b"<!DOCTYPE": "a web page and not the file itself: download it again, raw",
    b"<html": "a web page and not the file itself: download it again, raw",
    b"{": "JSON and no table of numbers: write root, joints and fps with np.savez, or a table (.csv)",
    b"/annex/objects/": "a git-annex pointer and not the file itself: run 'git annex get'",
}


# what files begin with, and what is to be done with them under another ending
_KINDS = {
    b"PK\x03\x04": ("an archive of NumPy or a zip file", (".npz",)),
    b"\x93NUMPY": ("an array of NumPy", (".npy",)),
    b"\x80\x02": ("a pickle", _PICKLES),
    b"\x80\x03": ("a pickle", _PICKLES),
    b"\x80\x04": ("a pickle", _PICKLES),
    b"\x80\x05": ("a pickle", _PICKLES),
}


def refuse_foreign(start: bytes, ending: str = "") -> None:
    """Raise for files that stand in for motion files, and for those that are of another kind than their ending says.

    Args:
        start: the first bytes of a file.
        ending: of its name, in small letters.

    Raises:
        MotionError: naming what it is and what to do.

    >>> refuse_foreign(b"version https://git-lfs.github.com/spec/v1")
    Traceback (most recent call last):
    plat.errors.MotionError: a Git LFS pointer and not the file itself: run 'git lfs pull' where it comes from
    """
    if not start:
        raise MotionError("not a readable file: it is empty")
    for magic, what in _MAGIC.items():
        if start.lstrip().lower().startswith(magic.lower()):
            raise MotionError(what)
    if ending and start.startswith(_GZIP) and ending not in _PICKLES:
        raise MotionError("it is compressed with gzip: unpack it first")
    for magic, (kind, endings) in _KINDS.items():
        if ending and start.startswith(magic) and ending not in endings:
            raise MotionError(f"it is {kind}, and no {ending} file: end its name in {endings[0]}")


def refuse_human_body(fields: Collection[str]) -> None:
    """Raise for files of human bodies: the SMPL family, as AMASS has them, and poselib where it is no ``.npy``.

    Args:
        fields: names of arrays or fields of a file.

    Raises:
        MotionError: where these are a human body's pose or shape and no robot's.
    """
    robot = {"joint_pos", "qpos", "dof", "dof_pos"} & set(fields)
    if robot:
        return
    if {"poses", "trans"} <= set(fields) or any(name in fields for name in _BODY_POSES):
        raise MotionError(
            "human motion of the SMPL family (AMASS), not of a robot: retarget it first, with GMR for instance, or "
            "write its joints' places in the world with np.savez(path, joints=[T, 22, 3], fps=...) and run plat "
            "motions retarget"
        )
    if {"skeleton_tree", "rotation"} <= set(fields):
        raise MotionError(
            "human motion of poselib (AMP, ASE), not of a robot: write its joints' places in the world with "
            "np.savez(path, joints=[T, J, 3], joint_names=[...], fps=...) and run plat motions retarget"
        )
    if any(name in fields for name in _BODY_SHAPES):
        raise MotionError("a human body's shape of the SMPL family (AMASS), no motion: leave it out")


def refuse_bare_joints(found: object) -> None:
    """Raise for an array that may be joint positions of a human, as HumanML3D has them: it states no frame rate.

    Args:
        found: what a file holds.

    Raises:
        MotionError: naming its shape and what to do.

    >>> refuse_bare_joints(np.zeros((40, 36)))
    """
    if isinstance(found, np.ndarray) and found.ndim == 3 and found.shape[2] == len("xyz"):
        raise MotionError(
            f"it holds an array of shape {found.shape}: if these are joint positions of a human, write them with "
            "np.savez(path, joints=array, fps=rate)"
        )


def refuse_old_arrays(fields: Collection[str]) -> None:
    """Raise for the first data sets of loco-mujoco, which have one array a coordinate and are of older robots.

    Args:
        fields: names of arrays of a file.

    Raises:
        MotionError: naming what it is and what to do.

    >>> refuse_old_arrays(["q_pelvis_tx", "q_pelvis_tilt"])  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    plat.errors.MotionError: an old data set of loco-mujoco, one array a coordinate, of another body: take ...
    """
    if set(_OLD_ROOT) <= set(fields):
        raise MotionError(
            "an old data set of loco-mujoco, one array a coordinate, of another body: take the data set of today's "
            "loco-mujoco, an array 'qpos' of the robot"
        )
