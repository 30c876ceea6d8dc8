"""List the released trackers that plat can run, and say which of them files are.

plat baselines
plat baselines downloads/*.onnx
"""

from plat.baselines.catalog import CATALOG, identify, sha256
from plat.cli.options import BaselinesRecipe
from plat.errors import PlatError


def main(recipe: BaselinesRecipe) -> None:
    """Print the list, or what files are."""
    for path in recipe.files:
        if not path.is_file():
            why = "is a folder, expected a file" if path.is_dir() else "no such file"
            raise PlatError(f"{str(path)!r}: {why}")
        known = identify(path)
        what = f"{known.name}, {known.version}" if known else f"not known (SHA-256 {sha256(path)})"
        print(f"{path}: {what}")
    if not recipe.files:
        print("\n\n".join(baseline.described() for baseline in CATALOG.values()))
        print("\nplat ships none of these files. Each may also teach a student: docs/components.md.")
