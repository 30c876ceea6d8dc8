"""Write the policy of a run as a bundle for robots and other simulators: ONNX, metadata, scene, model card, example.

plat export runs/plat --out bundle
"""

from plat.cli.options import ExportRecipe
from plat.export import export_bundle
from plat.robots import get_robot
from plat.runs.user_modules import import_modules
from plat.words import counted


def main(recipe: ExportRecipe) -> None:
    """Run the recipe."""
    import_modules(recipe.imports)
    get_robot(recipe.robot)  # a description file makes the policy's robot known
    check = export_bundle(recipe.run, recipe.out, picture=True)
    print(f"wrote {recipe.out}: {', '.join(sorted(path.name for path in recipe.out.iterdir()))}")
    print(
        f"largest difference from torch over {counted(check.rows, 'observation')}: "
        f"{check.max_difference:.2g} rad of joint target"
    )
