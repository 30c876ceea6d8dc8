"""Entrant of an evaluation: a policy with its robot and its view of the reference."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.envs import Transform

from plat.envs.transforms import Horizon, horizon_named
from plat.evaluation.bundle_policy import BundlePolicy
from plat.evaluation.clip_playback import play
from plat.evaluation.clip_records import ClipRecords
from plat.evaluation.records import CommandRecords
from plat.evaluation.scoring import evaluate
from plat.evaluation.setting import EvaluationSetting, Interface, ReferenceView
from plat.evaluation.whole_clip import evaluate_clips
from plat.modules import Expert
from plat.motions.library import MotionLibrary
from plat.rendering.playback import Playback
from plat.robots import G1
from plat.robots.robot import Robot
from plat.runs.policies import Policy, deployed
from plat.runs.saved_run import load_policy
from plat.spec.timing import Timing, timing_of

__all__ = ["Entrant", "ReferenceTracker"]


class ReferenceTracker(Protocol):
    """Protocol of a policy that adds the transforms of its own reference; :class:`plat.baselines.Tracker` is one."""

    robot: Robot

    def observe(self, library: MotionLibrary, dense: bool) -> Sequence[Transform]:
        """Return transforms that add what it reads: of the dense reference, or of the commanded keyframe."""

    def __call__(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ``action``."""


@dataclass(frozen=True)
class Entrant:
    """Entrant of an evaluation: a policy, its robot, and its view of the reference.

    Attributes:
        policy: deterministic policy.
        robot: that it drives.
        view: how it is shown its reference.
        tracks: whether it is a dense tracker, for which :data:`plat.evaluation.setting.Interface` is a choice.

    >>> from plat.motions import generate_motions
    >>> from plat.robots import G1
    >>> library = MotionLibrary.from_clips(generate_motions("val", seconds=8))
    >>> records = Entrant.of_policy(Expert(G1), dense=True).evaluate(library, "long")
    >>> bool(records.failed.any())
    True
    """

    policy: TensorDictModuleBase
    robot: Robot
    view: ReferenceView = field(default_factory=ReferenceView)
    tracks: bool = False

    @classmethod
    def of_policy(cls, policy: Policy, dense: bool = False, interface: Interface = "next-frame") -> "Entrant":
        """Return a policy of plat as an entrant. An expert is shown all frames it asks for, where there are any.

        Args:
            policy: as :func:`plat.load` and :func:`plat.runs.load_policy` return it.
            dense: show the reference motion in place of the keyframe.
            interface: motion that an expert is shown on its way to a keyframe; of no effect on other policies.
        """
        if not isinstance(policy, Expert):
            return cls(deployed(policy), policy.robot, ReferenceView(dense))
        if dense or interface != "next-frame":
            view = ReferenceView(dense, policy.goals, interface=interface)
            return cls(deployed(policy, tuple(policy.goals)), policy.robot, view, tracks=True)
        return cls(deployed(policy), policy.robot, tracks=True)

    @classmethod
    def of_run(
        cls, run: Path, device: str = "cpu", dense: bool = False, interface: Interface = "next-frame"
    ) -> "Entrant":
        """Return the policy of a run directory as an entrant."""
        return cls.of_policy(load_policy(run, device), dense, interface)

    @classmethod
    def of_bundle(cls, bundle: Path, robot: Robot = G1, dense: bool = False) -> "Entrant":
        """Return the policy of an exported bundle as an entrant.

        Args:
            bundle: its folder, or the ``.onnx`` file alone.
            robot: that it drives.
            dense: show the reference motion in place of the keyframe.
        """
        return cls(BundlePolicy(bundle, robot), robot, ReferenceView(dense))

    @classmethod
    def of_tracker(
        cls, tracker: ReferenceTracker, dense: bool = False, interface: Interface = "next-frame"
    ) -> "Entrant":
        """Return a released tracker as an entrant."""
        view = ReferenceView(dense, observe=tracker.observe, interface=interface)
        return cls(tracker, tracker.robot, view, tracks=True)

    @property
    def timing(self) -> Timing:
        """Return the timing that the policy carries; the default one when it has none."""
        return timing_of(self.policy) or Timing()

    def evaluate(
        self, library: MotionLibrary, horizon: str | Horizon, setting: EvaluationSetting | None = None, **options: Any
    ) -> CommandRecords:
        """Return its records on every command of a library.

        Args:
            library: motions of any robot with the same joints.
            horizon: of the commands, or its name, see :func:`plat.envs.transforms.horizon_named`.
            setting: conditions.
            options: further arguments of :func:`plat.evaluation.evaluate`.
        """
        lengths = horizon_named(horizon, self.timing) if isinstance(horizon, str) else horizon
        motions = library.for_robot(self.robot)
        return evaluate(self.policy, motions, lengths, setting, **vars(self.view), **options)

    def evaluate_clips(
        self,
        library: MotionLibrary,
        rule: str,
        horizon: str | Horizon | None = None,
        setting: EvaluationSetting | None = None,
        **options: Any,
    ) -> ClipRecords:
        """Return its records on whole clips.

        Args:
            library: motions of any robot with the same joints.
            rule: of success.
            horizon: of the commands, or its name.
            setting: conditions.
            options: further arguments of :func:`plat.evaluation.evaluate_clips`.
        """
        lengths = horizon_named(horizon, self.timing) if isinstance(horizon, str) else horizon
        motions = library.for_robot(self.robot)
        return evaluate_clips(self.policy, motions, rule, lengths, setting, **vars(self.view), **options)

    def play(self, library: MotionLibrary, horizon: Horizon, clip: int = 0, **options: Any) -> Playback:
        """Return its playback on the commands that a motion has among all of a library.

        Args:
            library: all motions that it is scored on, of any robot with the same joints.
            horizon: of the commands.
            clip: number of the motion.
            options: further arguments of :func:`plat.evaluation.play`.
        """
        return play(self.policy, library.for_robot(self.robot), clip, horizon, **vars(self.view), **options)
