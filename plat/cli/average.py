"""Average the weights of runs that came from one another.

plat average runs/before runs/after --out runs/average
"""

from plat.cli.options import AverageRecipe
from plat.runs.announce import next_command
from plat.runs.average import average_runs


def main(recipe: AverageRecipe) -> None:
    """Run the recipe."""
    average_runs(recipe.runs, recipe.out, recipe.shares, recipe.symmetric, recipe.reach)
    print(next_command(recipe.out, "plat evaluate", *recipe.runs, recipe.out, "--motions", ("test.npz",)))
