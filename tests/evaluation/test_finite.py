import math

import pytest
import torch
from tensordict.nn import TensorDictModule

from plat.control.authored import author
from plat.envs.transforms import HORIZONS
from plat.errors import ActionError
from plat.evaluation import evaluate
from plat.evaluation.authored_scores import evaluate_authored
from plat.evaluation.finite import check_actions
from plat.motions import MotionLibrary
from plat.robots import G1


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_one_action_is_enough(value: float) -> None:
    actions = torch.zeros(3, 29)
    actions[2, 4] = value
    with pytest.raises(ActionError, match=f"robot 2 the action {value} for joint 4"):
        check_actions(actions)
    check_actions(actions, active=torch.tensor([True, True, False]))


@pytest.fixture
def broken() -> TensorDictModule:
    return TensorDictModule(lambda pos: torch.full_like(pos, math.nan), [("robot", "joint_pos")], ["action"])


def test_a_policy_of_nans_has_no_score(library: MotionLibrary, broken: TensorDictModule) -> None:
    # it had a TKS@3 of 97 % at horizon single: MuJoCo puts such robots back upright
    with pytest.raises(ActionError, match="mean nothing"):
        evaluate(broken, library, HORIZONS["single"])
    with pytest.raises(ActionError, match="mean nothing"):
        evaluate_authored(broken, G1, author("steps", G1, 1, seed=0))


def test_an_absurd_action_is_a_fall(library: MotionLibrary) -> None:
    wild = TensorDictModule(lambda pos: torch.full_like(pos, 2e4), [("robot", "joint_pos")], ["action"])
    records = evaluate(wild, library, HORIZONS["long"], clips=[0])
    assert bool(records.failed.all())
    assert bool(records.fell.all())
