"""Checks of losses and gradients for values that are not finite."""

from torch import Tensor

from plat.errors import ActionError

__all__ = ["check_loss"]


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
