"""Stable-Baselines3 adapter of plat's batched gymnasium environment.

Needs Stable-Baselines3: ``pip install 'plat-rl[sb3]'``.
"""

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from plat.errors import PlatError
from plat.extras import importing

with importing("sb3", "plat.envs.sb3 needs", ImportError):
    from stable_baselines3.common.vec_env import VecEnv

__all__ = ["BatchVecEnv"]


class BatchVecEnv(VecEnv):
    """A gymnasium vector environment as a ``VecEnv`` of Stable-Baselines3.

    Each robot's ``infos`` entry has the entries of :class:`plat.envs.gym.G1TimedKeyframeEnv`'s ``info``. At the end of
    an episode it also has ``terminal_observation``, ``TimeLimit.truncated``, and ``is_success``, which
    Stable-Baselines3 logs as the success rate.

    Args:
        env: a vector environment that resets within the same step.

    Raises:
        PlatError: for one that resets in another way.

    >>> import gymnasium
    >>> from plat.envs.sb3 import BatchVecEnv
    >>> BatchVecEnv(gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=2)).reset().shape
    (2, 177)
    """

    def __init__(self, env: VectorEnv):
        mode = env.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise PlatError(f"env: its autoreset_mode is {mode}, expected {AutoresetMode.SAME_STEP}")
        self._env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._actions = np.empty(0)

    def reset(self) -> np.ndarray:
        """Reset every robot and return the first observations ``[N, 177]``."""
        # VecEnv.seed keeps one seed per robot; the batch takes the first
        observation = self._env.reset(seed=self._seeds[0])[0]
        self._reset_seeds()
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Step the batch."""
        observation, reward, terminated, truncated, info = self._env.step(self._actions)
        done = terminated | truncated
        entries = {key: value.tolist() for key, value in info.items() if f"_{key}" in info and key != "final_obs"}
        infos: list[dict[str, Any]] = [
            {key: values[index] for key, values in entries.items()} for index in range(self.num_envs)
        ]
        for index in done.nonzero()[0]:
            infos[index]["terminal_observation"] = info["final_obs"][index]
            infos[index]["TimeLimit.truncated"] = bool(truncated[index] and not terminated[index])
        return observation, reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Close the batch."""
        self._env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return the batch's attribute, once per robot that is asked for."""
        return [getattr(self._env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise an error: the robots share one environment."""
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Raise an error: the robots share one environment."""
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each robot that is asked for: none has wrappers of its own."""
        return [False for _ in self._get_indices(indices)]
