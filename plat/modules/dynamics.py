"""A learned one-step model of the robot, for policies that are trained on imagined rollouts."""

import torch
from torch import Tensor, nn

from plat.bounds import Natural, Positive, check_robot, check_value
from plat.envs.state import GeneralizedState
from plat.errors import ActionError, ConfigError, ObservationError
from plat.modules.networks import mlp
from plat.modules.settings import DynamicsConfig
from plat.robots.robot import Robot
from plat.rotations import (
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    quat_rotate,
    quat_rotate_inverse,
    quat_to_rotvec,
)

__all__ = ["DynamicsConfig", "DynamicsModel"]


class DynamicsModel(nn.Module):
    r"""One-step model of a robot under joint position targets: the state a control step later.

    A network predicts the change of the root's velocities and of the joint velocities, in the root frame. Positions
    follow by the trapezoid rule, with a small correction that the network predicts as well:

    .. math::
        v' = v + \delta_v, \quad
        q' = q + \tfrac{1}{2} (v + v') \, dt + \delta_q

    It sees gravity, height, root velocities, joint angles, joint velocities and target minus angle. Place on the floor
    and heading are no inputs, so that what it learned holds everywhere.

    Args:
        robot: the robot.
        config: shape of the network.
        dt: control step (s).
        num_parameters: of the robot's physics that it is told, P: friction, mass, gains; 0 for the nominal robot.

    Attributes:
        spread: standard deviation of the change of a step ``[12 + 3 J]``: root linear and angular velocity, joint
            velocities, corrections of root position, root orientation and joint angles. It scales the output.

    Source: the world model of SuperTrack (Fussell et al. 2021), integrated as in ControlVAE (arXiv 2210.06063).

    >>> from plat.robots import G1
    >>> model = DynamicsModel(G1, DynamicsConfig(hidden=(16,)))
    >>> state = GeneralizedState.unpack(torch.nn.functional.pad(torch.ones(5, 1), (3, 67)))
    >>> model(state, G1.default_joint_pos.expand(5, -1)).joint_pos.shape
    torch.Size([5, 29])
    """

    mean: Tensor
    std: Tensor
    spread: Tensor
    batches: Tensor

    def __init__(self, robot: Robot, config: DynamicsConfig | None = None, dt: float = 0.02, num_parameters: int = 0):
        super().__init__()
        check_robot(robot)
        check_value("dynamics model: config", config, DynamicsConfig | None)
        check_value("dynamics model: dt", dt, Positive)
        check_value("dynamics model: num_parameters", num_parameters, Natural)
        self.num_parameters = num_parameters
        self.robot = robot
        self.config = config = config or DynamicsConfig()
        self.dt = dt
        joints = robot.num_joints
        self._parts = (3, 3, joints, 3, 3, joints)
        features = 10 + 3 * joints + num_parameters
        self.network = mlp(features, config.hidden, sum(self._parts), out_scale=0.1)
        self.register_buffer("mean", torch.zeros(features))
        self.register_buffer("std", torch.ones(features))
        self.register_buffer("spread", torch.ones(sum(self._parts)))
        self.register_buffer("batches", torch.zeros((), dtype=torch.int64))

    def forward(self, state: GeneralizedState, target: Tensor, parameters: Tensor | None = None) -> GeneralizedState:
        """Return the state after a control step.

        Args:
            state: now, ``[*B]``.
            target: joint position targets ``[*B, J]`` (rad) that are held for the step.
            parameters: of the robots' physics ``[*B, P]``, about -1 to 1; None for the nominal robot, all 0. A
                friction of 0 is the middle of its range, which need not be the robot's own.

        Raises:
            ObservationError: for states, targets or parameters of another width.
        """
        features, lin_vel_b = self._features(state, target, parameters)
        # five standard deviations: beyond what it has seen, the model is not asked to extrapolate
        normalized = ((features - self.mean) / self.std).clamp(-5.0, 5.0)
        change = self.network(normalized) * self.spread
        lin_vel_change, ang_vel_change, joint_vel_change, way, turn, angle = change.split(self._parts, -1)
        half = 0.5 * self.dt
        next_lin_vel_b = lin_vel_b + lin_vel_change
        ang_vel_b = state.root_ang_vel_b + ang_vel_change
        joint_vel = state.joint_vel + joint_vel_change
        in_frame = torch.stack((half * (lin_vel_b + next_lin_vel_b) + way, next_lin_vel_b), -2)
        moved_w, lin_vel_w = quat_rotate(state.root_quat_w[..., None, :], in_frame).unbind(-2)
        rotvec = half * (state.root_ang_vel_b + ang_vel_b) + turn
        quat = quat_multiply(state.root_quat_w, quat_from_rotvec(rotvec))
        return GeneralizedState(
            state.root_pos_w + moved_w,
            torch.nn.functional.normalize(quat, dim=-1),
            state.joint_pos + half * (state.joint_vel + joint_vel) + angle,
            lin_vel_w,
            ang_vel_b,
            joint_vel,
        )

    @torch.no_grad()
    def update_statistics(
        self,
        state: GeneralizedState,
        target: Tensor,
        next_state: GeneralizedState,
        parameters: Tensor | None = None,
    ) -> None:
        """Take steps ``[*B]`` into the statistics of the inputs, which forget by ``1 / e`` in 50 batches.

        The spread of the output is that of the first three batches: later it would change what the network says.
        Batches of less than two steps have none, and change nothing.

        Raises:
            ActionError: for states or targets that are not finite; the statistics stay what they were.
            ObservationError: as of :meth:`forward`.
        """
        features = self._features(state, target, parameters)[0]
        features = features.reshape(-1, features.shape[-1])
        if len(features) < 2:
            return
        mean, spread = features.mean(0), self.spread
        if first := int(self.batches) < 3:
            spread = self._change(state, next_state).reshape(-1, len(spread)).std(0).clamp_min_(1e-6)
        if not (mean.isfinite().all() and spread.isfinite().all()):
            raise ActionError(
                "dynamics model: states or joint targets hold NaN or infinity; nothing was learned from this batch"
            )
        rate = max(1.0 / (int(self.batches) + 1), 0.02)
        self.mean.lerp_(mean, rate)
        self.std.lerp_((features - mean).square_().mean(0).sqrt_().clamp_min_(1e-3), rate)
        if first:
            self.spread.lerp_(spread, rate)
        self.batches += 1

    @torch.no_grad()
    def take_over(self, trained: "DynamicsModel") -> None:
        """Take the weights of a model that was told less or more of the physics.

        What it was not told counts for nothing yet. What this one is not told is that of the nominal robot.

        Raises:
            ConfigError: when the layers differ.
        """
        if trained.config != self.config:
            raise ConfigError(f"a model of {trained.config}, expected {self.config}")
        weights, size = trained.state_dict(), len(self.mean)
        first, bias, mean, std = (weights[name] for name in ("network.0.weight", "network.0.bias", "mean", "std"))
        nominal = (-mean / std).clamp(-5.0, 5.0)[size:]
        further = max(0, size - len(mean))
        pad = torch.nn.functional.pad
        weights |= {
            "network.0.weight": pad(first[:, :size], (0, further)),
            "network.0.bias": bias + first[:, size:] @ nominal,
            "mean": pad(mean[:size], (0, further)),
            "std": pad(std[:size], (0, further), value=0.6),
        }
        self.load_state_dict(weights)

    def _features(
        self, state: GeneralizedState, target: Tensor, parameters: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        joints, told = self.robot.num_joints, self.num_parameters
        for what, values, width in (
            ("joint_pos of the state", state.joint_pos, joints),
            ("target", target, joints),
            ("parameters", parameters, told),
        ):
            if values is not None and values.shape[-1:] != (width,):
                raise ObservationError(f"dynamics model: {what} {tuple(values.shape)}, expected [*B, {width}]")
        gravity_b, lin_vel_b = state.in_root_frame()
        features: tuple[Tensor, ...] = (
            gravity_b,
            state.root_pos_w[..., 2:],
            lin_vel_b,
            state.root_ang_vel_b,
            state.joint_pos,
            state.joint_vel,
            target - state.joint_pos,
        )
        if self.num_parameters:
            nominal = target.new_zeros(*target.shape[:-1], self.num_parameters)
            features = (*features, nominal if parameters is None else parameters)
        return torch.cat(features, -1), lin_vel_b

    def _change(self, state: GeneralizedState, after: GeneralizedState) -> Tensor:
        """What a perfect network would have to predict ``[*B, 12 + 3 J]``."""
        half = 0.5 * self.dt
        moves = torch.stack((state.root_lin_vel_w, after.root_lin_vel_w, after.root_pos_w - state.root_pos_w), -2)
        # both velocities in the frame of the first state, in which the network predicts them
        before_b, after_b, way_b = quat_rotate_inverse(state.root_quat_w[..., None, :], moves).unbind(-2)
        turn = quat_to_rotvec(quat_multiply(quat_conjugate(state.root_quat_w), after.root_quat_w))
        return torch.cat(
            (
                after_b - before_b,
                after.root_ang_vel_b - state.root_ang_vel_b,
                after.joint_vel - state.joint_vel,
                way_b - half * (before_b + after_b),
                turn - half * (state.root_ang_vel_b + after.root_ang_vel_b),
                after.joint_pos - state.joint_pos - half * (state.joint_vel + after.joint_vel),
            ),
            -1,
        )
