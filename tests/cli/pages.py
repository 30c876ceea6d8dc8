"""Pages whose commands users copy."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = [ROOT / "README.md", ROOT / "plat" / "weights" / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
