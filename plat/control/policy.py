"""Controller of one robot by a torch policy."""

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.bounds import check_value, is_finite, shown
from plat.deploy import ObservationBuilder, Pose, RobotState
from plat.deploy.state import finite_vector
from plat.entries import check_policy
from plat.errors import ActionError, StateError
from plat.robots.describe import describe_robot
from plat.robots.robot import Robot
from plat.spec.observation import optional_groups
from plat.spec.timing import Timing, timing_of

__all__ = ["PolicyController"]


class PolicyController:
    """Controller of one robot by a policy that reads the groups ``"robot"``, ``"goal"`` and ``"command"``.

    Args:
        policy: deterministic policy, on the CPU; ``load_policy(run).deployed()``.
        robot: the robot that it drives.
        timing: of the policy; None for the one that it carries, or the default where it carries none.

    Attributes:
        timing: of the policy.
        sees_parts: whether the policy sees which parts of a pose a keyframe commands.

    >>> from plat.robots import G1
    >>> from plat.keyframes import standing
    >>> from plat.modules import Expert
    >>> from plat.control import Simulator
    >>> simulator = Simulator(G1.model())
    >>> simulator.reset(standing(G1))
    >>> controller = PolicyController(Expert(G1).deployed(), G1)
    >>> controller(simulator.state(), standing(G1), steps_left=10).shape
    (29,)
    """

    def __init__(self, policy: TensorDictModuleBase, robot: Robot, timing: Timing | None = None):
        check_policy(policy, "controller")
        self._policy = policy
        check_value("controller: timing", timing, Timing | None)
        self.timing = timing or timing_of(policy) or Timing()
        description = describe_robot(robot, self.timing.control_dt)
        also = optional_groups(getattr(policy, "in_keys", ()))
        self._observe = ObservationBuilder(description, self.timing.max_steps, also, self.timing.window)
        self._joint_names = description.joint_names
        self.sees_parts = "parts" in also
        self._default = description.default_joint_pos
        self._scale = description.action_scale
        self.reset()

    def reset(self, joint_target: NDArray[np.floating] | None = None) -> None:
        """Start a new chase; see :class:`plat.control.Controller`.

        Raises:
            StateError: for a target of another size, or that is not finite.
        """
        target = self._default if joint_target is None else joint_target
        target = finite_vector("joint_target", target, len(self._joint_names))
        self._last_action = (target - self._default) / self._scale

    @torch.no_grad()
    def __call__(self, state: RobotState, keyframe: Pose, steps_left: int) -> NDArray[np.float64]:
        """Compute joint targets; see :class:`plat.control.Controller`.

        Raises:
            ActionError: for an action that is not finite, naming the joint, or of another size; it is not remembered.
            StateError: naming what is wrong with state, keyframe or time.
        """
        if not (is_finite(steps_left) and 0 < steps_left <= self.timing.max_steps):
            raise StateError(f"steps_left is {shown(steps_left)}, expected above 0 and at most {self.timing.max_steps}")
        values = torch.from_numpy(self._observe(state, keyframe, steps_left, self._last_action))[None]
        observation = TensorDict({}, [1])
        for term in self._observe.terms:
            observation[tuple(term.name.split("."))] = values[:, term.start : term.stop]
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            action = self._policy(observation)["action"]
        if action.shape != (1, len(self._joint_names)):
            expected = f"expected [*B, {len(self._joint_names)}], one number a joint"
            raise ActionError(f"the policy's action has shape {tuple(action.shape)} for one robot, {expected}")
        action = action[0].double().numpy()
        wrong = np.flatnonzero(~np.isfinite(action))
        if wrong.size:
            raise ActionError(
                f"the policy's action for joint {self._joint_names[wrong[0]]!r} is {action[wrong[0]]}, expected finite "
                "numbers"
            )
        self._last_action = action
        return self._default + self._scale * self._last_action
