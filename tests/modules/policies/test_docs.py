"""The student that docs/components.md writes out is plat's."""

import re
from pathlib import Path

import torch

from plat.collectors import PrivilegedGoals
from plat.envs import make_keyframe_env
from plat.modules import LatentPolicy, LatentPolicyConfig
from plat.objectives import LatentImitationLoss
from plat.robots import G1

PAGE = Path(__file__).parents[3] / "docs" / "components.md"


def test_the_student_in_ten_lines_trains_the_same_model(library):
    example = re.search(r"## A student in ten lines.*?```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    names: dict = {}
    exec(example.group(1), names)
    sizes = LatentPolicyConfig(
        backbone=(512,), hidden_size=128, decoder=(256,), latent_size=8, prior=(64,), posterior=(64,), encoder_size=64
    )
    student = LatentPolicy(G1, sizes)
    parts = ("normalizer", "backbone", "prior", "goal_normalizer", "encoder", "posterior", "decoder")
    for part in parts:
        getattr(student, part).load_state_dict(names[part].state_dict())
    batch = PrivilegedGoals(library, stride=5)(make_keyframe_env(library, 16).reset())
    batch["expert_action"] = torch.ones(16, 29)
    for name in ("normalizer", "goal_normalizer"):  # statistics that do something
        getattr(student, name).update(batch)
        names[name].update(batch)
    losses = []
    for loss in (names["loss"], LatentImitationLoss(student.training_graph(), beta=0.01)):
        torch.manual_seed(3)
        losses.append(loss(batch))
        sum(value for name, value in losses[-1].items() if name.startswith("loss_")).backward()
    torch.testing.assert_close(losses[0], losses[1])
    for part in parts:
        for name, weight in names[part].named_parameters():
            torch.testing.assert_close(weight.grad, getattr(student, part).get_parameter(name).grad)
    action = names["deploy"](batch.clone())["action"]
    torch.testing.assert_close(action, student.deployed()(batch.clone())["action"])
