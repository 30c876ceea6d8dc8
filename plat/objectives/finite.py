"""Checks of losses and gradients for values that are not finite."""

from torch import Tensor

from plat.errors import ActionError

__all__ = ["FiniteUpdates", "check_loss"]

_SKIPPED_IN_A_ROW = 50


def check_loss(loss: Tensor, what: str) -> Tensor:
    """Return a loss, or the norm of a gradient, if it is finite.

    One observation that is not finite makes it so, and a step on it would ruin nearly every weight.

    Args:
        loss: a number.
        what: it is; begins the message.

    Raises:
        ActionError: when it is not finite.

    >>> import torch
    >>> check_loss(torch.tensor(1.0), "imitation").item()
    1.0
    """
    if not loss.isfinite().all():
        raise ActionError(
            f"{what}: {loss.item():g}, expected a finite number; nothing was learned from this batch: its "
            "observations, actions or rewards are not finite, or a learning rate is too high"
        )
    return loss


class FiniteUpdates:
    """Guard of updates whose gradient is now and then not finite, as that of an imagined rollout that explodes.

    Such updates are skipped. Where all are, nothing is learned any more, and training stops.

    Args:
        what: is updated; begins the message.

    >>> import torch
    >>> updates = FiniteUpdates("policy")
    >>> [updates.allow(torch.tensor(norm)) for norm in (1.0, float("nan"), 2.0)]
    [True, False, True]
    """

    def __init__(self, what: str):
        self._what = what
        self.in_a_row = 0
        """Updates that were skipped since the last one that was not."""

    def allow(self, norm: Tensor) -> bool:
        """Return whether an update may be done, by the norm of its gradient.

        Raises:
            ActionError: when the last 50 were not finite.
        """
        if bool(norm.isfinite().all()):
            self.in_a_row = 0
            return True
        self.in_a_row += 1
        if self.in_a_row >= _SKIPPED_IN_A_ROW:
            raise ActionError(
                f"{self._what}: the gradients of {self.in_a_row} updates in a row were not finite, so that nothing is "
                "learned any more: lower its learning rate, imagine fewer steps, or go on from an earlier checkpoint"
            )
        return False
