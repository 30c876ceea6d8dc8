"""Search for settings of stage 1 with Ray Tune: learning rate and passes over a rollout.

pip install 'ray[tune]'
python examples/search.py
"""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from plat.recipes import expert
from plat.recipes.options import ExpertRecipe
from plat.runs.search import trainable

RECIPE = ExpertRecipe(motions=("generated:train@600",), minutes=5, num_envs=512, out=Path("runs/search"))


def search(recipe: ExpertRecipe = RECIPE, samples: int = 16, cpus: int = 2) -> dict[str, Any]:
    """Return the settings that left the fewest terminations a second."""
    from ray import tune

    train = tune.with_resources(trainable(expert.main, recipe, cpus=cpus), {"cpu": cpus})
    space = {"ppo.lr": tune.loguniform(1e-4, 1e-3), "ppo.epochs": tune.choice([3, 5])}
    options = tune.TuneConfig(num_samples=samples, metric="terminations_per_second", mode="min")
    best = tune.Tuner(train, param_space=space, tune_config=options).fit().get_best_result()
    return dict(best.config)


if __name__ == "__main__":
    if find_spec("ray") is None:
        sys.exit("error: needs pip install 'ray[tune]'")
    print(search())
