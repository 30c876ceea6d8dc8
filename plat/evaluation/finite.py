"""Check of an evaluation's actions for values that are not finite."""

import torch
from torch import Tensor

from plat.errors import ActionError

__all__ = ["check_actions"]


def check_actions(action: Tensor, active: Tensor | None = None) -> None:
    """Stop an evaluation at the first action that is not finite.

    MuJoCo would put such a robot back to its start, upright, and it would look successful.

    Args:
        action: ``[N, J]``.
        active: robots ``[N]`` that count; None for all.

    Raises:
        ActionError: naming robot and joint.

    >>> check_actions(torch.zeros(2, 29))
    """
    bad = ~torch.isfinite(action)
    if active is not None:
        bad = bad & active[:, None]
    if bad.any():
        robot, joint = bad.nonzero()[0].tolist()
        raise ActionError(
            f"the policy gave robot {robot} the action {float(action[robot, joint])} for joint {joint}, expected finite"
            " numbers; scores of such a policy mean nothing"
        )
