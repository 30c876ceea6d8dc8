"""User-supplied files of released trackers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from plat.baselines.catalog import CATALOG

if TYPE_CHECKING:
    from plat.baselines.tracker import Tracker

__all__ = ["ReleasedTrackers"]


@dataclass(frozen=True, kw_only=True)
class ReleasedTrackers:
    """Files of released dense trackers, which plat does not ship; plat baselines says where to get them."""

    sonic: Path | None = None
    """folder with the first SONIC's model_encoder.onnx and model_decoder.onnx"""
    sonic_1_1: Path | None = None
    """the same of SONIC 1.1"""
    protomotions: Path | None = None
    """folder with ProtoMotions' unified_pipeline.onnx and .yaml"""
    twist2: Path | None = None
    """TWIST2's .onnx"""
    wbc: Path | None = None
    """the .onnx of wbc-mjlab"""
    yahmp: Path | None = None
    """YAHMP's .onnx"""

    def files(self) -> dict[str, Path | None]:
        """Return the path of each by its name in tables."""
        given = {name: getattr(self, baseline.flag.replace("-", "_")) for name, baseline in CATALOG.items()}
        return {name: None if path is None else Path(path) for name, path in given.items()}

    def load(self) -> dict[str, Tracker]:
        """Load the trackers whose files were given, by their names in tables.

        Raises:
            BundleError: when a file cannot be read.
            CheckpointError: when it is another network.
        """
        return {name: CATALOG[name].load(path) for name, path in self.files().items() if path is not None}
