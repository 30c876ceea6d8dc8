"""Motion files: make them from motion capture.

python recipes/motions.py retarget bvh/ --out motions
"""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from plat.envs.motions import save_motions
from plat.envs.motions.retargeting import (
    Retargeted,
    SolverOptions,
    bvh_paths,
    load_map,
    retarget_all,
    split_of,
)
from plat.errors import MotionError
from plat.training import report_errors


@dataclass(kw_only=True)
class Retarget:
    """Turn human motion capture in BVH files into motions of the G1."""

    files: Annotated[tuple[str, ...], tyro.conf.Positional]
    """BVH files, folders or globs"""
    out: Path
    """folder to write to"""
    map: Path | None = None
    """skeleton map (YAML), see docs/retargeting.md; by default one that comes with plat"""
    split: bool = False
    """write train.npz, val.npz and test.npz by clip name instead of a file for each BVH file"""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """processes to spread the files over, at most; a few files are done in one"""
    solver: SolverOptions = SolverOptions()
    """how inverse kinematics is done"""


def retarget(recipe: Retarget) -> list[Retargeted]:
    """Run the subcommand: write the files, print a line a clip, return what was made.

    Raises:
        MotionError: at the end, when a file could not be used; the others are written.
    """
    paths = bvh_paths(recipe.files)
    skeleton = None if recipe.map is None else load_map(recipe.map)
    recipe.out.mkdir(parents=True, exist_ok=True)
    made, failed = [], 0
    print(
        f"{'clip':<44}{'frames':>7}{'s':>7}{'error cm':>10}{'depth mm':>10}{'float mm':>10}{'slip cm/s':>11}{'f/s':>6}"
    )
    for result in retarget_all(paths, skeleton, options=recipe.solver, workers=recipe.workers):
        if isinstance(result, MotionError):
            print(f"skipped: {result}", flush=True)
            failed += 1
            continue
        made.append(result)
        print(line(result), flush=True)
        if not recipe.split:
            save_motions(recipe.out / f"{result.clip.name}.npz", [result.clip])
    if recipe.split:
        for split in ("train", "val", "test"):
            clips = [result.clip for result in made if split_of(result.clip.name) == split]
            if clips:
                save_motions(recipe.out / f"{split}.npz", clips)
            print(f"{split}: {len(clips)} clips, {sum(clip.duration for clip in clips):.0f} s")
    if failed:
        raise MotionError(f"{failed} of {len(paths)} BVH files could not be used; see above")
    return made


def line(result: Retargeted) -> str:
    """One row of the table."""
    clip, frames = result.clip, len(result.clip.qpos)
    return (
        f"{clip.name:<44}{frames:>7}{clip.duration:>7.1f}{100 * result.error:>10.2f}{1000 * result.penetration:>10.2f}"
        f"{1000 * result.floating:>10.2f}{100 * result.slip:>11.2f}{frames / result.seconds:>6.0f}"
    )


if __name__ == "__main__":
    with report_errors():
        retarget(tyro.extras.subcommand_cli_from_dict({"retarget": Retarget}))
