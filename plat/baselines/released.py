"""User-supplied files of released trackers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from plat.baselines.tracker import Tracker

__all__ = ["ReleasedTrackers"]


@dataclass(frozen=True, kw_only=True)
class ReleasedTrackers:
    """Files of released dense trackers, which plat does not ship."""

    sonic: Path | None = None
    """folder with SONIC's model_encoder.onnx and model_decoder.onnx"""
    twist2: Path | None = None
    """TWIST2's .onnx"""
    wbc: Path | None = None
    """the .onnx of wbc-mjlab"""

    def files(self) -> dict[str, Path | None]:
        """Return the path of each by its name in tables."""
        return {"SONIC": self.sonic, "TWIST2": self.twist2, "wbc": self.wbc}

    def load(self) -> dict[str, Tracker]:
        """Load the trackers whose files were given, by their names in tables.

        Raises:
            BundleError: when a file cannot be read.
            CheckpointError: when it is another network.
        """
        from plat.baselines.sonic import Sonic  # torch: a help text has no use for it
        from plat.baselines.twist2 import Twist2
        from plat.baselines.wbc import Wbc

        kinds: dict[str, Callable[[Path], Tracker]] = {"SONIC": Sonic, "TWIST2": Twist2, "wbc": Wbc}
        return {name: kinds[name](path) for name, path in self.files().items() if path is not None}
