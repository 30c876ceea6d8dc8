"""A policy class of your own that runs save, resume and load like plat's.

python examples/registered_policy.py
"""

from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp

import torch

from plat.modules import LatentPolicy, LatentPolicyConfig, LatentPrior
from plat.robots import G1, Robot
from plat.runs import Budget, Run, is_run, load_policy, register_policy


class WidePriorPolicy(LatentPolicy):
    """A student with a wider prior."""

    def __init__(self, robot: Robot, config: LatentPolicyConfig = LatentPolicyConfig()):  # noqa: B008 (frozen)
        prior = LatentPrior(config.hidden_size, config.latent_size, hidden=(512, 512))
        super().__init__(robot, config, prior=prior)


register_policy("wide_prior", WidePriorPolicy, LatentPolicyConfig)


@dataclass
class Settings:
    """Settings, which are kept in config.json."""

    lr: float = 1e-3


folder, student, budget = Path(mkdtemp()) / "run", WidePriorPolicy(G1), Budget(steps=2000)
optimizer = torch.optim.Adam(student.parameters(), lr=Settings().lr)
state = {"optimizer": optimizer}
with Run(folder, recipe=Settings(), policy=student, budget=budget, state=state, resume=is_run(folder)) as run:
    while not budget.done:
        budget.add(1000)  # here something is learned
        run.log({"loss": 1.0})
    run.finish()
print(type(load_policy(folder)).__name__)  # WidePriorPolicy
