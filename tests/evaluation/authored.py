"""Made-up records of authored keyframes."""

import torch

from plat.evaluation.authored_scores import AuthoredRecords


def authored_records(chains: int = 4) -> AuthoredRecords:
    """Chains of two families; the robots of the second one fall."""
    fell = torch.arange(chains) >= chains // 2
    keyframes = torch.zeros(chains, 5)
    return AuthoredRecords(
        ["arms" if not down else "far" for down in fell],
        sample=torch.arange(chains),
        reached=(~fell)[:, None].expand(-1, 5).clone(),
        fell_before=fell[:, None].expand(-1, 5).clone(),
        root_error=keyframes,
        joint_error=keyframes.clone(),
        body_error=keyframes.clone(),
        feasible=torch.ones(chains, 5, dtype=torch.bool),
        fell=fell,
        fell_in_hold=torch.zeros_like(fell),
        foot_travel=torch.zeros(chains),
        stepped=torch.zeros_like(fell),
        in_pose=~fell,
        at_rest=~fell,
    )
