"""Policy as a function of a single observation vector, without TensorDict."""

from collections.abc import Iterator
from itertools import pairwise

import torch
from tensordict import NestedKey
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn

from plat.errors import BundleError
from plat.modules import ObservationNormalizer
from plat.modules.lead import LEAD_KEYS, KeyframeShift
from plat.runs.policies import Policy
from plat.spec.observation import entry_shapes, optional_groups, student_keys

__all__ = ["JointTargetNetwork"]


class JointTargetNetwork(nn.Module):
    """Network from a flat observation to joint position targets, without TensorDict.

    Computes ``q_target = q_default + scale * a`` with the policy's own modules and weights. Entries that TensorDict
    keys carry from one module to the next are passed in a dictionary. That is fast for a single robot, and exports to
    ONNX.

    Args:
        policy: any policy that plat saves. An expert treats the keyframe as its next reference frame and ignores
            the time to it.

    >>> import torch
    >>> from plat.robots import G1
    >>> from plat.modules import LatentPolicy
    >>> JointTargetNetwork(LatentPolicy(G1))(torch.zeros(2, 177)).shape
    torch.Size([2, 29])
    """

    default_joint_pos: Tensor
    action_scale: Tensor
    shifts: Tensor

    def __init__(self, policy: Policy):
        super().__init__()
        robot = policy.robot
        self._slices: dict[NestedKey, slice] = {}
        self.num_features = 0
        """Size of an observation F."""
        self.keys = student_keys(optional_groups(policy.deployed().in_keys))
        """Entries of an observation, in order."""
        for group, name in self.keys:
            start, (width,) = self.num_features, entry_shapes(group, robot)[name]
            self.num_features = start + width
            self._slices[group, name] = slice(start, self.num_features)
        # a lead shifts positions within the observation, all alike: one product replaces a dozen small
        # operations, each of which takes an onboard computer a microsecond
        shifts = torch.zeros(3, self.num_features)
        for name in LEAD_KEYS:
            columns = self._slices["led_goal", name] = self._slices["goal", name]
            for axis in range(2):
                shifts[axis, columns.start + axis : columns.stop : 3] = 1.0
        self.register_buffer("shifts", shifts)
        steps = list(_steps(policy.deployed()))
        self._check(steps)
        self._keys = [(step.in_keys, step.out_keys) for step in steps]
        # one that sees parts moves only what is commanded
        self._in_place = [
            isinstance(step.module, KeyframeShift)
            and not step.module.scaled
            and step.in_keys[0][0] == "goal"
            and len(step.in_keys) == 3
            for step in steps
        ]
        written = {key for step, moved in zip(steps, self._in_place, strict=True) if not moved for key in step.out_keys}
        self._joined = [
            isinstance(step.module, ObservationNormalizer)
            and written.isdisjoint(step.in_keys)
            and self._follow(step.in_keys)
            for step in steps
        ]
        self.parts = nn.ModuleList(step.module for step in steps)
        self.register_buffer("default_joint_pos", robot.default_joint_pos.clone())
        self.register_buffer("action_scale", robot.action_scale.clone())

    def _check(self, steps: list[TensorDictModule]) -> None:
        """Raise a :class:`BundleError` for a module that is no function of a robot's observation."""
        known = set(self._slices)
        for step in steps:
            if not isinstance(step, TensorDictModule):
                raise BundleError(
                    f"the deployed policy holds a {type(step).__name__}; only TensorDictModule and sequences of it "
                    "are exported"
                )
            if unknown := [key for key in step.in_keys if key not in known]:
                raise BundleError(
                    f"the deployed policy reads {unknown[0]!r}, which a robot does not observe; expected some of "
                    f"{self.keys}"
                )
            known |= set(step.out_keys)
        if "action" not in known:
            raise BundleError("the deployed policy writes no 'action'")

    def _follow(self, keys: list[NestedKey]) -> bool:
        """Return whether entries follow each other in the observation; several frames of an expert are the same one."""
        return all(self._slices[before].stop == self._slices[after].start for before, after in pairwise(keys))

    def forward(self, observation: Tensor) -> Tensor:
        """Compute joint position targets ``[*B, J]`` (rad) for observations ``[*B, F]`` in the order of
        :attr:`keys`.
        """
        values: dict[NestedKey, Tensor] = {}
        steps = zip(self.parts, self._keys, self._in_place, self._joined, strict=True)
        for part, (in_keys, out_keys), in_place, joined in steps:
            if in_place and isinstance(part, KeyframeShift):
                root, _, time_left = (observation[..., self._slices[key]] for key in in_keys)
                observation = observation + (root * part.share(time_left)) @ self.shifts
                continue
            if joined:
                # it puts its entries side by side, and in the observation they are
                first, last = self._slices[in_keys[0]], self._slices[in_keys[-1]]
                results = part(observation[..., first.start : last.stop])
            else:
                results = part(
                    *(values[key] if key in values else observation[..., self._slices[key]] for key in in_keys)
                )
            values.update(zip(out_keys, results if isinstance(results, tuple) else (results,), strict=True))
        return self.default_joint_pos + self.action_scale * values["action"]


def _steps(module: TensorDictModuleBase) -> Iterator[TensorDictModule]:
    """Return the modules of nested sequences in the order in which they run."""
    if isinstance(module, TensorDictSequential):
        for part in module.module:
            yield from _steps(part)
    else:
        yield module
