"""Pages whose commands users copy, and what reads their commands."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))
from shell_blocks import calls  # noqa: E402 (its folder is no package)

__all__ = ["DOCS", "ROOT", "calls"]

DOCS = [ROOT / "README.md", ROOT / "plat" / "weights" / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
