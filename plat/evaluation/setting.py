"""Conditions of an evaluation, and the view of the reference in it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import torch
from torchrl.envs import Transform

from plat.bounds import Bounded, Count, Robots, Seed, check_value
from plat.envs.transforms import NEXT_FRAME, DenseGoal, RandomizationRanges, TerminationLimits
from plat.evaluation.disturbance import Disturbance
from plat.evaluation.in_between import PlannedGoal
from plat.evaluation.names import Interface
from plat.motions.library import MotionLibrary
from plat.robots.robot import FootContacts
from plat.spec.timing import Timing

__all__ = ["EvaluationSetting", "Interface", "Observe", "ReferenceView"]

Observe = Callable[..., Sequence[Transform]]
"""Makes transforms that add further groups for a policy to read. Arguments: motions, and whether the policy is shown
the dense reference; also ``interface=``, where that is not the next frame. :meth:`plat.baselines.Tracker.observe` is
one."""


@dataclass(frozen=True)
class EvaluationSetting(Bounded):
    """Conditions that are the same for every policy of a comparison.

    Attributes:
        seed: of the commands, and of what is drawn.
        randomization: ranges of domain randomization and pushes; None for the nominal robot. A robot is drawn for each
            motion and stays to its end. Pushes and noise are at its frames. All are the same for every policy.
        disturbance: of fixed strength, for robustness curves; None for none.
        limits: when a command has failed.
        partial: kind of partial keyframes that all commands are, one of :data:`plat.envs.part_masks.PART_KINDS`; None
            for whole ones.
        timing: of the policy; None for the one that it carries, or the default at the control step of the motions.
        decimation: physics steps in a control step.
        feet: contact geometry of the soles.
        num_envs: robots that are simulated at a time. No score depends on it.
        num_threads: threads of the physics pool; None for one a core.
        device: of policy and tensors.
    """

    seed: Seed = 0
    randomization: RandomizationRanges | None = None
    disturbance: Disturbance | None = None
    limits: TerminationLimits | None = None
    partial: str | None = None
    timing: Timing | None = None
    decimation: Count = 4
    feet: FootContacts = "spheres"
    num_envs: Robots = 256
    num_threads: Count | None = None
    device: torch.device | str = "cpu"


@dataclass(frozen=True)
class ReferenceView:
    """View of the reference in a policy's observation: the commanded keyframe, or the dense motion.

    Attributes:
        dense: show the reference motion in place of the keyframe. Commands still set the windows in which it is scored.
        goals: with ``dense``, the groups that hold the reference, and how many frames ahead each is.
        observe: adds what the policy reads beside those groups.
        interface: motion that a dense tracker is shown on its way to a keyframe; of no effect with ``dense``.

    Raises:
        ConfigError: for an interface of another name.

    >>> ReferenceView().command_group, ReferenceView(dense=True).command_group
    ('goal', 'keyframe')
    """

    dense: bool = False
    goals: Mapping[str, int] = field(default_factory=lambda: NEXT_FRAME)
    observe: Observe | None = None
    interface: Interface = "next-frame"

    def __post_init__(self) -> None:
        # one of another name would be a line to the keyframe, and the scores those of a line
        check_value("reference view: interface", self.interface, Interface)

    @property
    def planned(self) -> bool:
        """Return whether the policy is shown a motion that leads to the keyframe."""
        return not self.dense and self.interface != "next-frame"

    @property
    def command_group(self) -> str:
        """Return the group of the commanded keyframe; one that the policy does not read where it is shown a motion."""
        return "keyframe" if self.dense or self.planned else "goal"

    def keyframes(self) -> "ReferenceView":
        """Return the view of keyframes, for chains that no dense motion leads through."""
        return replace(self, dense=False)

    def transforms(self, library: MotionLibrary) -> list[Transform]:
        """Return the transforms that show it, to stand after the one that issues commands."""
        shown: list[Transform] = []
        if self.dense:
            shown = DenseGoal.of_groups(library, self.goals)
        elif self.planned and self.observe is None:
            shown = PlannedGoal.of_groups(library, self.goals, self.interface)
        if self.observe is None:
            return shown
        if self.planned:
            return [*shown, *self.observe(library, False, interface=self.interface)]
        return [*shown, *self.observe(library, self.dense)]
