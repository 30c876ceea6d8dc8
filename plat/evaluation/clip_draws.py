"""Random draws of an evaluation, which belong to clips: every policy meets the same robots, pushes and noise."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from zlib import crc32

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.envs import Transform

from plat.envs.randomized_physics import PushClock, RandomizedPhysics
from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms import NoiseLevels, ObservationNoise
from plat.envs.transforms.randomization import apply_draw
from plat.envs.transforms.settings import RandomizationRanges
from plat.motions.library import MotionLibrary

__all__ = ["ClipDraws", "ClipNoise", "ClipSeeds", "RandomizedClips"]


@dataclass(frozen=True)
class ClipSeeds:
    """Seeds of what is drawn for each clip, whatever the other clips, the robots beside it, and its failures.

    Attributes:
        seed: of the evaluation.
        clips: number among all motions of each clip of a library.

    >>> part, whole = ClipSeeds(0, [7]), ClipSeeds(0, range(9))
    >>> part.of(0, "noise") == whole.of(7, "noise") != whole.of(7, "robot")
    True
    """

    seed: int
    clips: Sequence[int]

    def of(self, row: int, what: str) -> int:
        """Return the seed of what is drawn for a clip of the library."""
        # torch's generator on a CPU takes 32 bits, and sums of seeds and numbers would be those of the commands
        return crc32(f"{what}: seed {self.seed}, clip {self.clips[row]}".encode())


class ClipDraws(Transform):
    """Base of transforms that draw a robot for each clip, and pushes along it.

    A robot is drawn where a clip is taken on, and stays to its end. Drawn at every reset, a robot that fails would be
    changed for another one, and easy ones stay. Pushes come at frames of the clip, so that a failure puts none off. Put
    it before the transform that says where episodes start.

    Args:
        env: simulated robots, whose physics it changes.
        seeds: of the clips of the environment's library.
        push_interval: shortest and longest time between pushes (s); None for no pushes.
    """

    def __init__(self, env: MotionTrackingEnv, seeds: ClipSeeds, push_interval: tuple[float, float] | None):
        super().__init__()
        self._env = [env]  # in a list: nn.Module would otherwise adopt the environment as a child
        self._seeds = seeds
        self._push_interval = push_interval
        self._clip = torch.full((env.num_envs,), -1, device=env.device)
        self._pushes: dict[int, Tensor] = {}  # by frame of the library

    def draw(self, ids: Tensor) -> None:
        """Draw the robots ``[n]`` anew, from the default generator."""
        raise NotImplementedError

    def draw_pushes(self, count: int) -> Tensor:
        """Return changes of root velocity ``[count, 6]``, from the default generator."""
        raise NotImplementedError

    def _reset_env_preprocess(self, tensordict: TensorDictBase) -> TensorDictBase:
        clip = self._env[0].library.clip_of(tensordict["motion", "start"])
        new, mask = clip != self._clip, tensordict.get("_reset", None)
        if mask is not None:
            new &= mask.view(-1)
        self._clip = torch.where(new, clip, self._clip)
        for row in new.nonzero()[:, 0].tolist():
            number = int(clip[row])
            with _seeded(self._seeds.of(number, type(self).__name__)):
                self.draw(torch.tensor([row]))
                if self._push_interval is not None:
                    self._pushes |= self._pushes_along(number, self._push_interval)
        return tensordict

    def _pushes_along(self, clip: int, interval: tuple[float, float]) -> dict[int, Tensor]:
        library = self._env[0].library
        length = int(library.clip_length[clip])
        frames = PushClock(interval, library.dt, length).steps.cumsum(0)
        frames = frames[frames < length]
        return dict(zip((library.clip_start[clip].cpu() + frames).tolist(), self.draw_pushes(len(frames)), strict=True))

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        frames = tensordict["motion", "frame"].tolist() if self._pushes else []
        if due := [row for row, frame in enumerate(frames) if frame in self._pushes]:
            velocities = torch.stack([self._pushes[frames[row]] for row in due])
            self._env[0].physics.push(torch.tensor(due), velocities)
        return tensordict


class RandomizedClips(ClipDraws):
    """Domain randomization that draws a robot for each clip.

    The drift of its state estimate goes on where it is put back on the reference.

    Args:
        env: simulated robots, whose physics it changes.
        ranges: of the parameters.
        seeds: of the clips of the environment's library.
    """

    def __init__(self, env: MotionTrackingEnv, ranges: RandomizationRanges, seeds: ClipSeeds):
        super().__init__(env, seeds, ranges.push_interval)
        self._random = RandomizedPhysics(env.robot, env.physics, env.num_envs, ranges, env.library.dt)

    def draw(self, ids: Tensor) -> None:
        apply_draw(self._env[0], self._random.draw(ids), ids)

    def draw_pushes(self, count: int) -> Tensor:
        return self._random.draw_pushes(count)


class ClipNoise(ObservationNoise):
    """Observation noise that is the same at a frame of a clip whatever came before it. Put it last.

    Args:
        library: motions of the environment.
        levels: half widths.
        seeds: of the library's clips.
    """

    def __init__(self, library: MotionLibrary, levels: NoiseLevels, seeds: ClipSeeds):
        super().__init__(library.robot, levels)
        self.in_keys: list[NestedKey] = [*self.out_keys, ("motion", "frame")]
        self._library = library
        self._seeds = seeds
        self._generator = torch.Generator()

    def draw(self, tensordict: TensorDictBase, values: Tensor) -> Tensor:
        frame = tensordict["motion", "frame"]
        clip = self._library.clip_of(frame)
        ahead = frame - self._library.clip_start[clip]
        rows = []
        for number, steps in zip(clip.tolist(), ahead.tolist(), strict=True):
            self._generator.manual_seed(self._seeds.of(number, f"noise at {steps}"))
            rows.append(torch.rand(values.shape[-1], generator=self._generator))
        return torch.stack(rows).to(values)


@contextmanager
def _seeded(seed: int) -> Iterator[None]:
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(seed)
        yield
