"""Rivals of the comparison: simulation and training of a G1 on a CPU, by plat and its alternatives.

A rival's ``collect`` and ``learn`` run some environment steps and return their number. Both have a Gaussian policy of
three hidden layers (512, 256, 128) in the loop. ``learn`` adds PPO, with equal rollouts, minibatches and epochs.
"""

import functools
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from run import STEPS, collection
from single_env import SingleG1
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.collectors import Collector
from torchrl.envs import EnvCreator, GymWrapper, ParallelEnv, SerialEnv

from plat.collectors import simulation_threads
from plat.envs import make_keyframe_env
from plat.envs.physics import BatchedPhysics, PhysicsFactory, available_cpus
from plat.modules import ExpertConfig
from plat.modules.networks import mlp
from plat.motions import MotionLibrary
from plat.objectives import PPOConfig

__all__ = ["RIVALS", "Rival", "Setup", "Work", "work_with_plat"]

_HIDDEN = ExpertConfig().hidden
_STD = 0.35


@dataclass(frozen=True)
class Setup:
    """Setup that all rivals get."""

    motions: tuple[str, ...]
    """motion files"""
    num_envs: int
    """robots of rivals that simulate a batch"""
    num_singles: int
    """robots of rivals that have one environment per robot"""
    mjbatch: Path | None = None
    """folder of mjbatch and its MuJoCo"""

    @functools.cached_property
    def library(self) -> MotionLibrary:
        """Return the motions."""
        return MotionLibrary.load(self.motions)

    @property
    def samples(self) -> int:
        """Return the steps of all robots between two updates of PPO."""
        return self.num_envs * STEPS


@dataclass(frozen=True)
class Work:
    """Function that runs some environment steps and returns their number."""

    collect: Callable[[], int] | None = None
    learn: Callable[[], int] | None = None


@dataclass(frozen=True)
class Rival:
    """Row of the comparison."""

    name: str
    package: str
    """distribution whose version is shown"""
    install: str
    """how to install it"""
    make: Callable[[Setup, ExitStack], Work]
    """builds it; what must be closed goes onto the stack"""


class GaussianPolicy(nn.Module):
    """Gaussian policy around the output of a network."""

    def __init__(self, in_features: int, out_features: int):
        super().__init__()
        self.network = mlp(in_features, _HIDDEN, out_features)

    def forward(self, observation: Tensor) -> Tensor:
        """Return actions ``[*B, A]`` for observations ``[*B, F]``."""
        mean = self.network(observation)
        return mean + _STD * torch.randn_like(mean)

    @torch.no_grad()
    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return actions for arrays."""
        return self(torch.from_numpy(observation).float()).numpy()


def work_with_plat(setup: Setup, learn: bool, physics: PhysicsFactory = BatchedPhysics) -> Callable[[], int]:
    """Build plat's environment on some physics with policy and collector, and with ``learn`` also PPO."""
    measure = collection(make_keyframe_env(setup.library, setup.num_envs, physics=physics), learn)

    def work() -> int:
        measure()
        return setup.samples

    return work


def _plat(setup: Setup, stack: ExitStack) -> Work:
    return Work(work_with_plat(setup, learn=False), work_with_plat(setup, learn=True))


def _singles(setup: Setup) -> list[Callable[[], gymnasium.Env]]:
    # made here and handed on through fork: a child that runs torch after a fork may hang
    environments = [SingleG1(setup.library) for _ in range(setup.num_singles)]
    return [functools.partial(_identity, environment) for environment in environments]


def _identity(environment: SingleG1) -> SingleG1:
    return environment


def _gymnasium(setup: Setup, stack: ExitStack) -> Work:
    env = AsyncVectorEnv(_singles(setup), context="fork", autoreset_mode=AutoresetMode.SAME_STEP)
    stack.callback(env.close)
    observation, _ = env.reset(seed=0)
    policy = GaussianPolicy(observation.shape[1], env.action_space.sample().shape[1])

    def collect() -> int:
        nonlocal observation
        with simulation_threads(setup.num_singles):
            for _ in range(STEPS):
                observation, *_ = env.step(policy.act(observation))
        return STEPS * setup.num_singles

    return Work(collect)


def _torchrl(setup: Setup, stack: ExitStack) -> Work:
    makers = [EnvCreator(functools.partial(GymWrapper, make())) for make in _singles(setup)]
    # one process per core, each with several of the robots, is faster here than one process per robot
    processes = min(available_cpus(), len(makers))
    shares = [makers[first::processes] for first in range(processes)]
    serial = [EnvCreator(functools.partial(SerialEnv, len(share), share)) for share in shares]
    env = ParallelEnv(processes, serial, mp_start_method="fork")
    single = makers[0]()
    features, actions = single.observation_spec["observation"].shape[-1], single.action_spec.shape[-1]
    policy = TensorDictModule(GaussianPolicy(features, actions), in_keys=["observation"], out_keys=["action"])
    threads = torch.get_num_threads()
    collector = Collector(
        env,
        policy,
        frames_per_batch=STEPS * setup.num_singles,
        track_traj_ids=False,
        trust_policy=True,
        auto_register_policy_transforms=False,
    )
    stack.callback(collector.shutdown)
    # it has started its processes, and left PyTorch here on what they spare: one thread, for everybody's updates
    torch.set_num_threads(threads)
    rollouts = iter(collector)

    def collect() -> int:
        with simulation_threads(setup.num_singles):
            return next(rollouts).numel()

    return Work(collect)


def _stable_baselines(setup: Setup, stack: ExitStack, vector: Callable) -> Work:
    import stable_baselines3

    env = vector(setup)
    stack.callback(env.close)
    config = PPOConfig()
    model = stable_baselines3.PPO(
        "MlpPolicy",
        env,
        n_steps=setup.samples // env.num_envs,
        batch_size=setup.samples // config.minibatches,
        n_epochs=config.epochs,
        gamma=config.gamma,
        gae_lambda=config.lmbda,
        ent_coef=config.entropy,
        max_grad_norm=config.grad_norm,
        policy_kwargs={"net_arch": list(_HIDDEN), "activation_fn": nn.ELU},
        device="cpu",
    )

    def learn() -> int:
        before = model.num_timesteps
        model.learn(setup.samples, reset_num_timesteps=False)
        return model.num_timesteps - before

    return Work(learn=learn)


def _subprocesses_of_plat(setup: Setup) -> object:
    from stable_baselines3.common.vec_env import SubprocVecEnv

    make = functools.partial(gymnasium.make, "plat:plat/G1TimedKeyframe-v0", motions=setup.motions)
    return SubprocVecEnv([make] * setup.num_singles, start_method="forkserver")


def _subprocesses_of_numpy(setup: Setup) -> object:
    from stable_baselines3.common.vec_env import SubprocVecEnv

    return SubprocVecEnv(_singles(setup), start_method="fork")


def _batch_of_plat(setup: Setup) -> object:
    from plat.envs.sb3 import BatchVecEnv

    return BatchVecEnv(gymnasium.make_vec("plat/G1TimedKeyframe-v0", setup.num_envs, motions=setup.motions))


def _envpool(setup: Setup, stack: ExitStack) -> Work:
    import envpool

    # few robots: each holds a model of its own, of some 85 MB
    env = envpool.make_gymnasium(
        "G1JoystickFlatTerrain-v1", num_envs=setup.num_singles, num_threads=available_cpus(), sim_dt=0.005
    )
    stack.callback(env.close)
    policy = GaussianPolicy(env.observation_space["state"].shape[0], env.action_space.shape[0])
    observation = env.reset()[0]["state"]

    def collect() -> int:
        nonlocal observation
        with simulation_threads(setup.num_singles):
            for _ in range(STEPS):
                observation = env.step(policy.act(observation))[0]["state"]
        return STEPS * setup.num_singles

    return Work(collect)


def _mjbatch(setup: Setup, stack: ExitStack, current: bool) -> Work:
    """Run mjbatch in a separate process, since it needs its own version of MuJoCo; the process steps on request."""
    script = Path(__file__).parent / "on_mjbatch.py"
    paths = [str(setup.mjbatch or ""), os.environ.get("PYTHONPATH", "")]
    process = subprocess.Popen(
        [sys.executable, str(script), str(setup.num_envs), "current" if current else "old", *setup.motions],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in paths if path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        bufsize=1,
    )
    stack.callback(process.wait)
    assert process.stdin is not None
    assert process.stdout is not None
    requests, answers = process.stdin, process.stdout
    stack.callback(requests.close)  # the process ends when there is nothing more to read

    def collect() -> int:
        requests.write("collect\n")
        return int(answers.readline())

    return Work(collect)


_SB3 = ("stable-baselines3", "pip install stable-baselines3")
_MJBATCH = ("mjbatch", "pip install --no-deps --target DIR mjbatch==0.1.4 mujoco==3.14.0, then --mjbatch DIR")
RIVALS = (
    Rival("plat", "plat-rl", "pip install -e .", _plat),
    Rival("gymnasium AsyncVectorEnv, NumPy environments", "gymnasium", "pip install gymnasium", _gymnasium),
    Rival("TorchRL ParallelEnv, NumPy environments", "torchrl", "pip install torchrl", _torchrl),
    Rival(
        "Stable-Baselines3 PPO, plat/G1TimedKeyframe-v0 in processes",
        *_SB3,
        functools.partial(_stable_baselines, vector=_subprocesses_of_plat),
    ),
    Rival(
        "Stable-Baselines3 PPO, NumPy environments in processes",
        *_SB3,
        functools.partial(_stable_baselines, vector=_subprocesses_of_numpy),
    ),
    Rival(
        "Stable-Baselines3 PPO, plat's batched environment",
        *_SB3,
        functools.partial(_stable_baselines, vector=_batch_of_plat),
    ),
    Rival("EnvPool G1JoystickFlatTerrain", "envpool", "pip install envpool", _envpool),
    Rival("mjbatch under plat's environment", *_MJBATCH, functools.partial(_mjbatch, current=True)),
    Rival("mjbatch, its outputs a substep old", *_MJBATCH, functools.partial(_mjbatch, current=False)),
)
"""Rows of the comparison; the first is what the others are held against."""
