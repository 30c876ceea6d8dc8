import pytest
import torch

from plat.errors import ActionError
from plat.objectives.finite import FiniteUpdates, check_loss


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_loss_that_is_not_finite_is_refused(value):
    with pytest.raises(ActionError, match="imitation: (nan|inf), expected a finite number"):
        check_loss(torch.tensor(value), "imitation")


def test_updates_are_skipped_now_and_then_but_not_for_ever():
    updates = FiniteUpdates("policy")
    for _ in range(3):  # one that is finite begins the count anew
        assert not any(updates.allow(torch.tensor(torch.inf)) for _ in range(49))
        assert updates.allow(torch.tensor(0.5))
    for _ in range(49):
        updates.allow(torch.tensor(torch.nan))
    with pytest.raises(ActionError, match="policy: the gradients of 50 updates in a row were not finite"):
        updates.allow(torch.tensor(torch.nan))
