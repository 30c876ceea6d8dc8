"""Scheduled starts: episodes that issue every command of every clip exactly once."""

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import Transform

from plat.envs.transforms.command import CommandSchedule
from plat.motions.library import MotionLibrary

__all__ = ["ScheduledStarts"]


class ScheduledStarts(Transform):
    """Scheduled starts: each robot goes through clip after clip from the first frame on, longest clips first.

    After a failed command the robot is reset onto the reference where the next command begins. After a clip's last
    command it takes the next clip that no other robot has taken. Put it after the termination transform.

    Args:
        library: motions.
        schedule: the commands.
        num_envs: number of robots N.
    """

    def __init__(self, library: MotionLibrary, schedule: CommandSchedule, num_envs: int):
        super().__init__()
        device = library.device
        self._target = schedule.target_frame
        order = library.clip_length.argsort(descending=True, stable=True)
        self._queue = library.clip_start[order].tolist()[::-1]
        self.active = torch.zeros(num_envs, dtype=torch.bool, device=device)
        """Robots ``[N]`` that are in a clip of the schedule; the others have nothing left to do."""
        self._resume = torch.full((num_envs,), -1, dtype=torch.int64, device=device)

    @property
    def finished(self) -> bool:
        """Return whether every command has been issued and has ended."""
        return not self._queue and not bool(self.active.any())

    def _next_starts(self, ids: Tensor) -> None:
        for row in ids.tolist():
            if self._resume[row] >= 0:
                continue
            if self._queue:
                self._resume[row] = self._queue.pop()
                self.active[row] = True
            else:
                self.active[row] = False

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        frame = next_tensordict["motion", "frame"]
        over = self._target[frame] < 0
        next_tensordict["truncated"] = next_tensordict["truncated"] | over[:, None]
        next_tensordict["done"] = next_tensordict["terminated"] | next_tensordict["truncated"]
        # a failed command is followed by the next one of the clip, if there is one
        target = next_tensordict["command", "target_frame"]
        goes_on = next_tensordict["terminated"][:, 0] & (self._target[target] >= 0) & self.active
        self._resume = torch.where(goes_on, target, -1)
        return next_tensordict

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase:
        count = len(self.active)
        if tensordict is None:
            tensordict = TensorDict({}, [count], device=self.active.device)
        mask = tensordict.get("_reset", None)
        ids = torch.arange(count) if mask is None else mask.view(-1).nonzero()[:, 0]
        self._next_starts(ids)
        # robots without work stand at the first frame of the library
        tensordict["motion"] = TensorDict({"start": self._resume.clamp_min(0)}, [count])
        return tensordict
