"""Human motion capture in BVH files to motions of the robot; needs the extra ``plat-rl[retarget]``."""

from plat.motions.retargeting.bvh import Bvh, read_bvh
from plat.motions.retargeting.options import SolverOptions
from plat.motions.retargeting.retarget import Retargeted, bvh_paths, retarget, retarget_all
from plat.motions.retargeting.skeletons import SkeletonMap, builtin_maps, load_map
from plat.motions.split import split_of

__all__ = [
    "Bvh",
    "Retargeted",
    "SkeletonMap",
    "SolverOptions",
    "builtin_maps",
    "bvh_paths",
    "load_map",
    "read_bvh",
    "retarget",
    "retarget_all",
    "split_of",
]
