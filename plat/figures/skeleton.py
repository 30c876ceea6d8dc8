"""Picture of a skeleton with the joints of a map, to see whether the map is right."""

from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.figures.pyplot import pyplot, write_figure
from plat.motions.retargeting.capture_axes import AXES, check_sides, find_up
from plat.motions.retargeting.mocap import Mocap
from plat.motions.retargeting.skeletons import SkeletonMap

__all__ = ["draw_skeleton"]

_COLORS = {"left": "#0072b2", "right": "#d55e00", "": "#222222"}
_LIMB = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe")


def draw_skeleton(path: str | Path, mocap: Mocap, skeleton: SkeletonMap) -> str:
    """Draw a frame of a capture from the front and from its left, with the joints of a map and their names.

    The frame is one in which the body is upright on both feet and the hands are apart. Left is blue and right is
    orange; joints of no role are gray.

    Args:
        path: picture to write.
        mocap: whose joints are drawn.
        skeleton: which of them are which.

    Returns:
        What is wrong with the map, such as sides that are exchanged; empty where nothing was found.
    """
    at = {role: mocap.positions[:, mocap.names.index(name)] for role, name in skeleton.joints.items()}
    rest = {role: mocap.rest[mocap.names.index(name)] for role, name in skeleton.joints.items()}
    leg = float(np.linalg.norm(at["left_hip"] - at["left_knee"], axis=1).mean() * 2)
    wrong = []
    stated = None if skeleton.up == "auto" else AXES[skeleton.up]
    try:
        up, _ = find_up(at, rest, max(leg, 1e-9), stated, "map")
    except MotionError as error:
        up = 1 if stated is None else stated
        wrong.append(str(error).removeprefix("map: "))
    try:
        check_sides(at, "map", skeleton.name)
    except MotionError as error:
        wrong.append(str(error).removeprefix("map: "))
    frame = _clearest(at, up)
    points = _seen(mocap.positions[frame], {role: place[frame] for role, place in at.items()}, up) / max(leg, 1e-9)
    plt = pyplot()
    reach, margin = 2.3 * (1.2 * np.abs(points[:, 0]).max() + 0.1), 0.1
    depth = np.abs(points[:, 1]).max() + margin
    tall = float(np.ptp(points[:, 2])) + 2 * margin
    scale = 8.0 / tall
    figure, panels = plt.subplots(
        1, 2, figsize=(scale * 2 * (reach + depth), 9), sharey=True, width_ratios=(reach, depth), layout="constrained"
    )
    # seen from the front, a person's left is on the right
    for panel, across, half, title in zip(
        panels, (0, 1), (reach, depth), ("from the front", "from the left"), strict=True
    ):
        _draw(panel, points[:, [across, 2]], mocap, skeleton, labeled=across == 0)
        panel.set(title=title, aspect="equal", xlim=(-half, half))
        panel.set_ylim(points[:, 2].min() - margin, points[:, 2].max() + margin)
        panel.axis("off")
    told = "; ".join(wrong)
    figure.suptitle(f"{skeleton.name}: blue is left, orange is right" + (f"\n{told}" if told else ""), fontsize=11)
    write_figure(figure, path, dpi=110)
    plt.close(figure)
    return told


def _clearest(at: dict[str, np.ndarray], up: int) -> int:
    """Return the frame in which the body is tall, on both feet, with the hands apart."""
    ankles = np.stack((at["left_ankle"], at["right_ankle"]))[..., up]
    tall = at["neck"][:, up] - ankles.mean(0) - np.abs(ankles[0] - ankles[1])
    return int((tall + 0.5 * np.linalg.norm(at["left_wrist"] - at["right_wrist"], axis=1)).argmax())


def _seen(places: np.ndarray, at: dict[str, np.ndarray], up: int) -> np.ndarray:
    """Return places ``[J, 3]`` as left, behind and up of the hips, for a viewer that the person faces."""
    vertical = np.eye(3)[up]
    left = at["left_hip"] - at["right_hip"]
    left = left - vertical * (left @ vertical)
    left = left / max(float(np.linalg.norm(left)), 1e-9)
    behind = np.cross(vertical, left)
    return (places - at["hips"]) @ np.stack((left, behind, vertical), 1)


def _draw(panel: object, points: np.ndarray, mocap: Mocap, skeleton: SkeletonMap, labeled: bool) -> None:
    roles = {mocap.names.index(name): role for role, name in skeleton.joints.items()}
    for joint, parent in enumerate(mocap.parents):
        if parent >= 0:
            panel.plot(*points[[parent, joint]].T, color="0.75", linewidth=2, zorder=1)  # type: ignore[attr-defined]
    panel.scatter(*points.T, s=10, color="0.6", zorder=2)  # type: ignore[attr-defined]
    rows: dict[str, list[tuple[float, float, str]]] = {side: [] for side in _COLORS}
    # the left last, for it is nearer to who looks from the left
    for joint, role in sorted(roles.items(), key=lambda item: item[1], reverse=True):
        side = role.split("_")[0] if role.split("_")[-1] in _LIMB else ""
        panel.scatter(*points[joint], s=45, color=_COLORS[side], zorder=3)  # type: ignore[attr-defined]
        rows[side].append((float(points[joint, 1]), float(points[joint, 0]), f"{role}: {mocap.names[joint]}"))
    if labeled:
        _label(panel, points, rows)


def _label(panel: object, points: np.ndarray, rows: dict[str, list[tuple[float, float, str]]]) -> None:
    """Write the names in columns beside the figure, each with a line to its joint; the trunk's beside the left ones."""
    low, high = points[:, 1].min(), points[:, 1].max()
    reach = 1.2 * np.abs(points[:, 0]).max() + 0.1
    sides = (("right", -1, rows["right"]), ("left", 1, rows["left"] + rows[""]))
    for _, sign, listed in sides:
        listed = sorted(listed)
        for (height, across, text), row in zip(listed, np.linspace(low, high, max(len(listed), 2)), strict=False):
            side = text.split("_")[0] if text.split(":")[0].split("_")[-1] in _LIMB else ""
            panel.annotate(  # type: ignore[attr-defined]
                text,
                (across, height),
                (sign * reach, row),
                fontsize=8,
                color=_COLORS[side],
                va="center",
                ha="left" if sign > 0 else "right",
                arrowprops={"arrowstyle": "-", "color": _COLORS[side], "linewidth": 0.5, "alpha": 0.6},
            )
