"""Write the policy of a run as a bundle for robots and other simulators: ONNX, metadata, model card, example.

plat export runs/plat --out bundle
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from plat.export import export_bundle


@dataclass(kw_only=True)
class ExportRecipe:
    """Write the policy of a run as a bundle for robots and other simulators."""

    run: Annotated[Path, tyro.conf.Positional]
    """run directory of stage 2 or 3; scores in its evaluation.csv are taken along"""
    out: Path
    """folder to make"""


def main(recipe: ExportRecipe) -> None:
    """Run the recipe."""
    check = export_bundle(recipe.run, recipe.out)
    print(f"wrote {recipe.out}: {', '.join(sorted(path.name for path in recipe.out.iterdir()))}")
    print(
        f"largest difference from torch over {check.rows} observations: {check.max_difference:.2g} rad of joint target"
    )


COMMAND = ExportRecipe
