"""Human motion capture to motions of the robot; needs the extra ``plat-rl[retarget]``."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.motions.retargeting.asf import read_amc
    from plat.motions.retargeting.builtin import UnknownSkeletonError, builtin_maps, find_map, with_joints
    from plat.motions.retargeting.bvh import read_bvh
    from plat.motions.retargeting.mocap import Mocap
    from plat.motions.retargeting.options import SolverOptions
    from plat.motions.retargeting.retarget import (
        MOCAP_READERS,
        Retargeted,
        bvh_paths,
        read_capture,
        retarget,
        retarget_all,
    )
    from plat.motions.retargeting.skeletons import SkeletonMap, load_map, save_map
    from plat.motions.split import split_of
else:
    lazy(__name__)

__all__ = [
    "MOCAP_READERS",
    "Mocap",
    "Retargeted",
    "SkeletonMap",
    "SolverOptions",
    "UnknownSkeletonError",
    "builtin_maps",
    "bvh_paths",
    "find_map",
    "load_map",
    "read_amc",
    "read_bvh",
    "read_capture",
    "retarget",
    "retarget_all",
    "save_map",
    "split_of",
    "with_joints",
]
