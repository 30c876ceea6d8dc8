"""Data sets of any4hdmi: archives of ``qpos`` alone, whose rate and names stand in the data set's ``manifest.json``.

Source: EGalahad/any4hdmi, ``docs/dataset_format.md``.
"""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from plat.errors import MotionError
from plat.json_file import read_json
from plat.motions.formats.joint_columns import texts

__all__ = ["manifest_above", "stated_above"]

_NAME, _FOLDER = "manifest.json", "motions"
# columns of the root
_ROOT = 7


def manifest_above(path: Path) -> Path | None:
    """Return the ``manifest.json`` beside the folder ``motions`` that an archive lies in, at any depth, or None."""
    above = [folder.with_name(_NAME) for folder in path.absolute().parents if folder.name == _FOLDER]
    return next((file for file in above if file.is_file()), None)


def stated_above(path: Path, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the time step, and the names of the joints, that a manifest above an archive of ``qpos`` states, if any.

    Args:
        path: of the archive.
        arrays: that it has.
    """
    manifest = manifest_above(path) if "qpos" in arrays else None
    content: Any = None
    with suppress(MotionError):  # any data set may have such a file
        content = None if manifest is None else read_json(manifest, MotionError, _NAME)
    if not isinstance(content, dict) or type(content.get("timestep")) not in (int, float):
        return {}
    stated = {"timestep": np.array(content["timestep"])}
    names = texts(content.get("qpos_names"))
    if names and len(names) == arrays["qpos"].shape[-1] > _ROOT:
        stated["joint_names"] = np.array(names[_ROOT:])
    return stated
