"""The gradient of joint tracking through the motors, which PPO's noise hides."""

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor

from plat.envs.robot import Robot

__all__ = ["motor_gradient"]


def motor_gradient(
    rollout: TensorDictBase, robot: Robot, steps: int = 4, ahead: int = 1, goal: str = "goal", legs: float = 1.0
) -> Tensor:
    """Which way each joint's action was wrong, by where the joint was a moment later.

    A position-controlled joint goes where its target goes, with a lag of ``kd/kp`` (64 ms on the G1). So the joint's
    error ``e = q - q_ref``, ``steps`` after an action, falls when that action's target is lowered by ``e``:

    ``gradient_t = e_{t+steps} / action_scale``

    is a gradient on the mean action, with the motor's answer taken as the identity. It is 0 where the episode or the
    rollout ended before. The sign is right for joints that move freely, whatever gravity and inertia do; a leg that
    stands is also loaded through the other one, and its errors may be what balance asks for, hence ``legs``. The
    reward of a mean over all joints says little on any one of them, and PPO hears it through its own noise: on the
    G1 it leaves arms a tenth of a radian off in the same direction all the time. This removes such errors within
    minutes, and PPO keeps the robot on its feet.

    Args:
        rollout: ``[N, T]`` with ``("robot", "joint_pos")`` (rad, from the default pose), the joint angles of the
            reference in ``goal`` and ``("next", "done")``.
        robot: gives default pose and action scale.
        steps: control steps from the action to the error.
        ahead: how many frames ahead the goal is.
        goal: group of the reference.
        legs: factor on the joints of the legs.

    Returns:
        ``[N, T, J]``, for :meth:`plat.objectives.PPO.step`.

    Raises:
        ValueError: when ``steps`` is less than ``ahead``.

    >>> from plat.envs import G1, MotionLibrary, make_tracking_env
    >>> from plat.envs.motions import generate_motions
    >>> env = make_tracking_env(MotionLibrary.from_clips(generate_motions("train", seconds=8)), num_envs=2)
    >>> motor_gradient(env.rollout(6, break_when_any_done=False), G1).shape
    torch.Size([2, 6, 29])
    """
    if steps < ahead:
        raise ValueError(
            f"steps is {steps}: the reference of fewer than {ahead} steps after an action is not in the rollout"
        )
    joint_key: NestedKey = ("robot", "joint_pos")
    joint_pos = rollout[joint_key] + robot.default_joint_pos.to(rollout[joint_key])
    reference, done = rollout[goal, "joint_pos"], rollout["next", "done"]
    gradient = torch.zeros_like(joint_pos)
    kept = joint_pos.shape[1] - steps
    if kept <= 0:
        return gradient
    # the goal that was shown ``ahead`` steps before a state is the reference of that state
    error = joint_pos[:, steps:] - reference[:, steps - ahead : steps - ahead + kept]
    ended = done.unfold(1, steps, 1)[:, :kept].any(-1)
    gradient[:, :kept] = torch.where(ended, 0.0, error / robot.action_scale.to(error))
    gradient[..., robot.leg_joints] *= legs
    return gradient
