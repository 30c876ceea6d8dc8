"""Motor gradient: joint-tracking error through the motors, a per-joint signal that PPO's noise masks."""

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor

from plat.bounds import Natural, check_robot, check_value
from plat.entries import check_rollout
from plat.errors import ConfigError
from plat.objectives.settings import MotorGradientConfig
from plat.robots.robot import Robot
from plat.spec.observation import entries_of

__all__ = ["MotorGradientConfig", "motor_gradient"]


def motor_gradient(
    rollout: TensorDictBase,
    robot: Robot,
    config: MotorGradientConfig | None = None,
    *,
    ahead: int = 1,
    goal: str = "goal",
) -> Tensor:
    """Return the gradient of the joint-tracking error with respect to the action, with the motor modeled as a pure
    delay.

    A position-controlled joint goes where its target goes, with a lag of ``kd/kp`` (64 ms on the G1). So the joint's
    error ``e = q - q_ref``, ``steps`` after an action, falls when that action's target is lowered by ``e``:

    ``gradient_t = weight * e_{t+steps} / action_scale``

    is a gradient on the mean action, with the motor's response taken as the identity. It is 0 where the episode or
    the rollout ended before. The sign is right for joints that move freely, whatever gravity and inertia do. A stance
    leg is also loaded through the other one, and its errors may serve balance. The mean joint reward gives a weak
    per-joint signal under exploration noise: on the G1, arms keep a bias of 0.1 rad. The motor gradient removes such
    errors within minutes, while PPO keeps the robot balanced.

    Args:
        rollout: ``[N, T]`` with ``("robot", "joint_pos")`` (rad, from the default pose), the joint angles of the
            reference in ``goal`` and ``("next", "done")``.
        robot: gives default pose and action scale.
        config: weight and delay.
        ahead: number of frames that the reference's group is ahead.
        goal: group of the reference.

    Returns:
        ``[N, T, J]``, for :meth:`plat.objectives.PPO.step`.

    Raises:
        ConfigError: when the delay is less than ``ahead``.

    >>> from plat.envs import make_tracking_env
    >>> from plat.motions import MotionLibrary
    >>> from plat.robots import G1
    >>> from plat.motions import generate_motions
    >>> env = make_tracking_env(MotionLibrary.from_clips(generate_motions("train", seconds=8)), num_envs=2)
    >>> motor_gradient(env.rollout(6, break_when_any_done=False), G1).shape
    torch.Size([2, 6, 29])
    """
    config = config or MotorGradientConfig()
    check_robot(robot)
    check_value("motor gradient: ahead", ahead, Natural)
    check_rollout(rollout, "motor gradient", (("robot", "joint_pos"), (goal, "joint_pos"), ("next", "done")))
    steps = config.steps
    if steps < ahead:
        raise ConfigError(
            f"steps is {steps}: the reference of fewer than {ahead} steps after an action is not in the rollout"
        )
    joint_key: NestedKey = ("robot", "joint_pos")
    measured, wanted = entries_of((joint_key, (goal, "joint_pos")))
    joint_pos = measured.quantity(rollout[joint_key]) + robot.default_joint_pos.to(rollout[joint_key])
    reference, done = wanted.quantity(rollout[goal, "joint_pos"]), rollout["next", "done"]
    gradient = torch.zeros_like(joint_pos)
    kept = joint_pos.shape[1] - steps
    if kept <= 0:
        return gradient
    # the goal observed ``ahead`` steps before a state is the reference of that state
    error = joint_pos[:, steps:] - reference[:, steps - ahead : steps - ahead + kept]
    ended = done.unfold(1, steps, 1)[:, :kept].any(-1)
    gradient[:, :kept] = torch.where(ended, 0.0, config.weight * error / robot.action_scale.to(error))
    gradient[..., robot.leg_joints] *= config.legs
    return gradient
