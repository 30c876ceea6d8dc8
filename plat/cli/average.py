"""Average the weights of runs that came from one another.

plat average runs/before runs/after --out runs/average
"""

from plat.cli.options import AverageRecipe
from plat.robots import get_robot
from plat.runs.announce import next_command
from plat.runs.average import average_runs
from plat.runs.user_modules import import_modules


def main(recipe: AverageRecipe) -> None:
    """Run the recipe."""
    import_modules(recipe.imports)
    get_robot(recipe.robot)  # a description file makes the policies' robot known
    average_runs(recipe.runs, recipe.out, recipe.shares, recipe.symmetric, recipe.reach)
    runs = (*recipe.runs, recipe.out)
    print(next_command(recipe, "plat evaluate", *runs, "--motions", ("test.npz",)))
