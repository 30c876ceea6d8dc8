"""gymnasium environments of the timed keyframe task.

``import plat`` registers it. Without that import, gymnasium finds it as ``"plat:plat/G1TimedKeyframe-v0"``.

>>> import gymnasium, plat
>>> env = gymnasium.make("plat/G1TimedKeyframe-v0")
>>> observation, info = env.reset(seed=0)
>>> observation.shape
(177,)
"""

import secrets
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import plat.headless  # noqa: F401 - before MuJoCo, for render()
from plat.gpu import check_device

# isort: split
import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from tensordict import TensorDictBase
from torchrl.data import Binary, Composite
from torchrl.envs import Transform

from plat.bounds import check_value
from plat.envs.configs import KeyframeTaskConfig
from plat.envs.reach import distances
from plat.envs.settings import ReachLimits
from plat.envs.tasks import make_keyframe_env
from plat.envs.transforms import FailureWeightedStarts, KeyframeMetrics, horizon_named
from plat.envs.transforms.terminations import commanded_parts
from plat.errors import ActionError, TaskError
from plat.motions.library import MotionLibrary
from plat.robots import Robot, get_robot
from plat.spec.observation import observation_size, optional_groups, student_keys
from plat.spec.timing import Timing

__all__ = ["G1TimedKeyframeEnv", "G1TimedKeyframeVectorEnv"]

# An action of this size asks for several times a motor's torque; larger ones make no difference.
_ACTION_BOUND = 20.0
_NEAR = ("metrics", "near")
_VECTOR_ARGUMENTS = ("num_envs", "motions", "horizon", "task", "device", "timing", "also", "robot")


class _Nearness(Transform):
    """Transform that writes whether a robot is near enough to the reference in what is commanded, ``[1]``."""

    def __init__(self) -> None:
        super().__init__(out_keys=[_NEAR])

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        apart = distances(next_tensordict["state"], next_tensordict["reference"], commanded_parts(next_tensordict))
        return next_tensordict.set(_NEAR, apart.near(ReachLimits())[:, None])

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return tensordict_reset.set(_NEAR, torch.zeros_like(tensordict_reset["done"]))

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Add the mask."""
        shape = (*observation_spec.shape, 1)
        observation_spec[_NEAR] = Binary(1, shape, dtype=torch.bool, device=observation_spec.device)
        return observation_spec


def _generators(device: torch.device) -> list[torch.Generator]:
    """Return torch's global generators that an environment on a device draws from."""
    if device.type != "cuda":
        return [torch.default_generator]
    torch.cuda.init()  # they are not there before
    index = torch.cuda.current_device() if device.index is None else device.index
    return [torch.default_generator, torch.cuda.default_generators[index]]


class _Task:
    """TorchRL environment behind both gymnasium ones, with random numbers of its own."""

    def __init__(
        self,
        num_envs: int,
        motions: str | Sequence[str],
        horizon: str,
        task: KeyframeTaskConfig | None,
        device: str,
        timing: Timing,
        also: Sequence[str],
        robot: Robot | str,
    ):
        check_value("timing", timing, Timing)
        self._keys = student_keys(also)
        if getattr(task, "partial", 0) and "parts" not in optional_groups(self._keys):
            raise TaskError(
                "task.partial: the observation does not say which parts are commanded, expected also=('parts',)"
            )
        lengths = horizon_named(horizon, timing)
        driven = robot if isinstance(robot, Robot) else get_robot(robot)
        library = MotionLibrary.load(motions, driven, dt=timing.control_dt)
        self._generators = _generators(check_device(device))
        self._random_states = [generator.get_state() for generator in self._generators]
        # processes that were forked to run in parallel have the same state of torch's generators
        with self._own_randomness(secrets.randbits(63)):
            self.env = make_keyframe_env(library, num_envs, task, horizon=lengths, timing=timing, device=device)
        # after the reference and the clock, which they read
        self.env.insert_transform(2, KeyframeMetrics(library))
        self.env.insert_transform(3, _Nearness())
        self._starts = next(part for part in self.env.transform if isinstance(part, FailureWeightedStarts))
        self.robot = library.robot
        size = observation_size(self._keys, self.robot)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        bound = np.full(self.robot.num_joints, _ACTION_BOUND, np.float32)
        self.action_space = gymnasium.spaces.Box(-bound, bound)
        with self._own_randomness():
            self.current: TensorDictBase = self.env.reset()
        """Entries that the next step begins from."""

    @contextmanager
    def _own_randomness(self, seed: int | None = None) -> Iterator[None]:
        # transforms draw from torch's global generators: their states are swapped, so that seeding this environment
        # neither disturbs nor depends on what its user draws
        outside = [generator.get_state() for generator in self._generators]
        for generator, state in zip(self._generators, self._random_states, strict=True):
            generator.set_state(state)
            if seed is not None:
                generator.manual_seed(seed % 2**64)  # gymnasium's seeds are whole numbers of any size
        try:
            yield
        finally:
            self._random_states = [generator.get_state() for generator in self._generators]
            for generator, state in zip(self._generators, outside, strict=True):
                generator.set_state(state)

    def reset(self, seed: int | None) -> np.ndarray:
        if seed is not None:  # the same seed gives the same episode, whatever happened before
            self._starts.forget_all()
        with self._own_randomness(seed):
            self.current = self.env.reset()
        return self.flat(self.current)

    def flat(self, tensordict: TensorDictBase) -> np.ndarray:
        """Return observations ``[N, F]``."""
        return torch.cat([tensordict[key] for key in self._keys], -1).cpu().numpy()

    def step(self, actions: np.ndarray, auto_reset: bool) -> tuple[TensorDictBase, TensorDictBase]:
        """Step the environment; return the entries after the step, and those from which the next step begins."""
        actions, expected = np.asarray(actions), (self.env.batch_size[0], self.robot.num_joints)
        if actions.shape != expected or actions.dtype.kind not in "fiu":
            found = actions.shape[actions.shape[:1] == expected[:1] :]
            what = f"shape {found} and type {actions.dtype}"
            raise ActionError(f"action: {what}, expected numbers of shape {expected[-1:]} for each robot")
        if np.isnan(actions).any():
            raise ActionError(
                f"action: NaN for joint {self.robot.joint_names[int(np.isnan(actions).any(0).argmax())]!r}"
            )
        clipped = np.clip(actions, -_ACTION_BOUND, _ACTION_BOUND).astype(np.float32)
        with self._own_randomness():
            self.current["action"] = torch.from_numpy(clipped).to(self.env.device)
            if auto_reset:
                stepped, self.current = self.env.step_and_maybe_reset(self.current)
            else:
                stepped = self.env.step(self.current)
                self.current = stepped["next"].exclude("reward")
        return stepped["next"], self.current


class G1TimedKeyframeEnv(gymnasium.Env):
    """Gymnasium environment of one robot, a G1 by default, that is commanded to reach keyframes on time.

    The observation, ``[177]`` of the G1, holds the robot's state, the keyframe in the robot's frame, and the normalized
    horizon. Its order is that of :func:`plat.spec.observation.student_keys`. The action ``[J]`` offsets the joint
    targets from the default pose, in units of the action scale.

    An episode terminates when a command fails, and is truncated at the end of the motion. A command fails beyond the
    thresholds of TKS@3, and where the root is 0.5 m beside the motion. That limit is for training, and goes with
    ``task=KeyframeTaskConfig(max_displacement=None)``. ``info`` has:

    - ``is_success``: no command of the episode has failed;
    - ``arrived``: a command ended with this step;
    - ``met``: it arrived and has not failed;
    - ``reached``: it was met, and at the arrival what is commanded was near enough (:class:`plat.control.ReachLimits`);
    - ``steps_left``: control steps until the arrival of the command that is active next;
    - ``joint_error`` (rad), ``keypoint_error`` (m, world): mean errors against the motion at this moment, which at
      arrival is the keyframe.

    Args:
        motions: motion files, folders or globs, or ``"generated:train"``.
        horizon: lengths of the commands: a key of :data:`plat.envs.transforms.HORIZONS`, or "all" lengths.
        task: rewards, terminations and noise.
        render_mode: ``"rgb_array"`` for pictures by :meth:`render`.
        device: where tensors live.
        timing: control step, longest command and arrival window.
        also: groups that the observation has as well: ``"parts"``, which ``task.partial`` asks for, and ``"clock"``.
        robot: that is commanded: itself, its name, or the path of a description (:func:`plat.robots.get_robot`). Sizes
            of observation and action are then that robot's.

    Raises:
        RobotError: for what is no robot.
        TaskError: for an unknown horizon, and for partial keyframes without ``"parts"`` in ``also``.
        PlatError: for a horizon with commands longer than the timing allows.
        MotionError: for motions that cannot be read.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}

    def __init__(
        self,
        motions: str | Sequence[str] = "generated:train",
        horizon: str = "mixed",
        task: KeyframeTaskConfig | None = None,
        render_mode: str | None = None,
        device: str = "cpu",
        timing: Timing = Timing(),
        also: Sequence[str] = (),
        robot: Robot | str = "g1",
    ):
        self._task = _Task(1, motions, horizon, task, device, timing, also, robot)
        self.metadata = {**self.metadata, "render_fps": round(1 / timing.control_dt)}
        self.observation_space = self._task.observation_space
        self.action_space = self._task.action_space
        self.render_mode = render_mode
        self._stage: Any = None
        self._over = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start at a random frame of a random motion."""
        super().reset(seed=seed)
        self._over = False
        return self._task.reset(seed)[0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Hold the joint targets for one control step.

        Raises:
            ActionError: for an action that is none, or after the episode's end: the motion is over.
        """
        if self._over:
            raise ActionError("step: the episode is over, expected reset() before the next step")
        after, following = self._task.step(np.asarray(action)[None], auto_reset=False)
        flags = [bool(after[key]) for key in ("terminated", "truncated")]
        self._over = any(flags)
        info = {key: values[0].item() for key, values in _info(after, following).items()}
        return self._task.flat(after)[0], float(after["reward"]), *flags, info

    def render(self) -> np.ndarray | None:
        """Return a picture ``[480, 640, 3]`` of the robot and a translucent copy in its keyframe.

        Raises:
            RenderingError: where no OpenGL is available, with what to install.
        """
        if self.render_mode is None:
            return None
        from plat.rendering import Stage  # needs OpenGL, which training does not

        if self._stage is None:
            self._stage = Stage(self._task.robot)
        base = self._task.env.base_env
        ghost = base.library.qpos(self._task.current["command", "target_frame"])
        return self._stage.draw(base.qpos[0].cpu().numpy(), ghost[0].cpu().numpy())

    def close(self) -> None:
        """Release the renderer."""
        if self._stage is not None:
            self._stage.close()
            self._stage = None


class G1TimedKeyframeVectorEnv(VectorEnv):
    """Gymnasium environment of many G1s in one batch, with resets in the same step (``AutoresetMode.SAME_STEP``).

    ``info`` holds an array ``[N]`` for each entry of :class:`G1TimedKeyframeEnv`'s, and its mask under the same name
    with an underscore before it. ``final_obs`` has the last observations of the episodes that ended.

    Args:
        num_envs: number of robots.
        motions, horizon, task, device, timing, also, robot: as for :class:`G1TimedKeyframeEnv`.

    Raises:
        TaskError, PlatError, MotionError: as for :class:`G1TimedKeyframeEnv`, and for another argument.

    >>> env = gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=4)
    >>> env.reset(seed=0)[0].shape
    (4, 177)
    """

    autoreset_mode = AutoresetMode.SAME_STEP  # where TorchRL looks for it
    metadata = {"autoreset_mode": autoreset_mode}

    def __init__(
        self,
        num_envs: int = 1,
        motions: str | Sequence[str] = "generated:train",
        horizon: str = "mixed",
        task: KeyframeTaskConfig | None = None,
        device: str = "cpu",
        timing: Timing = Timing(),
        also: Sequence[str] = (),
        robot: Robot | str = "g1",
        **others: Any,
    ):
        # gymnasium hands on whatever make_vec() was given
        if unknown := [name for name, value in others.items() if value is not None]:
            raise TaskError(
                f"make_vec: unknown argument {unknown[0]!r}, expected some of {', '.join(_VECTOR_ARGUMENTS)}"
            )
        self._task = _Task(num_envs, motions, horizon, task, device, timing, also, robot)
        self.num_envs = num_envs
        self.single_observation_space = self._task.observation_space
        self.single_action_space = self._task.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start each robot at a random frame of a random motion."""
        super().reset(seed=seed)
        return self._task.reset(seed), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Hold the joint targets for one control step."""
        after, following = self._task.step(actions, auto_reset=True)
        reward, terminated, truncated = (
            after[key][:, 0].cpu().numpy() for key in ("reward", "terminated", "truncated")
        )
        done = terminated | truncated
        info: dict[str, Any] = _info(after, following)
        info |= {f"_{key}": np.ones(self.num_envs, bool) for key in info}
        if done.any():
            final = np.empty(self.num_envs, object)
            observations = self._task.flat(after)
            for index in done.nonzero()[0]:
                final[index] = observations[index]
            info |= {"final_obs": final, "_final_obs": done}
        return self._task.flat(following), reward.astype(np.float64), terminated, truncated, info


def _info(after: TensorDictBase, following: TensorDictBase) -> dict[str, np.ndarray]:
    """Return arrays ``[N]`` about the step that led to ``after``."""
    failed, arrived = after["terminated"], after["command", "arrived"]
    met = arrived & ~failed
    entries = {
        "is_success": ~failed,
        "arrived": arrived,
        "met": met,
        "reached": met & after[_NEAR],
        "steps_left": following["command", "steps_left"],
        "joint_error": after["metrics", "joint_error"],
        "keypoint_error": after["metrics", "keypoint_error"],
    }
    return {key: value[:, 0].cpu().numpy() for key, value in entries.items()}
