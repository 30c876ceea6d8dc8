"""Replay buffer of recent rollouts, sampled as windows of one episode each."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.data import TensorDictReplayBuffer
from torchrl.data.replay_buffers import ImmutableDatasetWriter, Sampler, Storage

from plat.bounds import Count, Robots, as_names, check_value
from plat.collectors.storage import DeviceStorage
from plat.entries import check_rollout
from plat.errors import ConfigError, ObservationError, StateError
from plat.gpu import check_device
from plat.words import counted

__all__ = ["RolloutReplay", "WindowSampler"]


class RolloutReplay:
    """Replay buffer of the last control steps of N robots, in a ring of TorchRL's ``LazyTensorStorage``.

    Rows are in the order of time, with the robots of a step adjacent: a robot's next step is N rows later. TorchRL's
    ``SliceSampler`` searches the whole storage for episode ends whenever it has grown. Here a window is sampled, and
    rejected if it contains an end, at a cost independent of the storage's size.

    Args:
        num_envs: robots N.
        capacity: control steps kept for each robot.
        keys: entries of a rollout to keep; groups are kept whole.
        device: device of the storage.

    >>> from tensordict import TensorDict
    >>> replay = RolloutReplay(num_envs=2, capacity=10, keys=["x"])
    >>> done = torch.zeros(2, 5, 1, dtype=torch.bool)
    >>> replay.extend(TensorDict({"x": torch.arange(10.0).view(2, 5), "next": {"done": done}}, [2, 5]))
    >>> window = replay.windows(batch=4, length=3)
    >>> window.shape, bool((window["x"].diff(dim=1) == 1).all())
    (torch.Size([4, 3]), True)
    """

    def __init__(self, num_envs: int, capacity: int, keys: Sequence[NestedKey], device: torch.device | str = "cpu"):
        check_value("replay: num_envs", num_envs, Robots)
        check_value("replay: capacity", capacity, Count)
        device = check_device(device, meta=True)
        self.num_envs = num_envs
        self.capacity = capacity
        self._keys = list(as_names(keys))
        self.steps = 0
        """Control steps of each robot that were ever written."""
        self._episode = torch.zeros(num_envs, dtype=torch.int64, device=device)
        self._sampler = WindowSampler(self)
        self.buffer = TensorDictReplayBuffer(
            storage=DeviceStorage(num_envs * capacity, device=device), sampler=self._sampler
        )
        self._recent_sampler = WindowSampler(self)
        self._recent = TensorDictReplayBuffer(
            storage=self.buffer.storage, sampler=self._recent_sampler, writer=ImmutableDatasetWriter()
        )

    def __len__(self) -> int:
        """Return the number of control steps kept for each robot."""
        return min(self.steps, self.capacity)

    def extend(self, rollout: TensorDictBase) -> None:
        """Add a rollout ``[N, T]`` that continues the last one.

        Raises:
            ConfigError: when the capacity is no multiple of its length: a rollout would wrap around the end.
        """
        check_rollout(rollout, "replay", (*self._keys, ("next", "done")))
        if len(rollout) != self.num_envs:
            raise ObservationError(f"replay: rollout of {counted(len(rollout), 'robot')}, expected {self.num_envs}")
        length = rollout.shape[1]
        if self.capacity % length:
            raise ConfigError(f"capacity is {self.capacity}, expected a multiple of the rollouts' {length} steps")
        ends = rollout["next", "done"][..., 0]
        pushed = rollout.get(("next", "pushed"), None)  # no window leads over a push, which nobody can foresee
        done = (ends if pushed is None else ends | pushed).long()
        ended = done.cumsum(1)
        kept = rollout.select(*self._keys)
        kept["episode"] = self._episode[:, None] + ended - done
        self._episode = self._episode + ended[:, -1]
        self.buffer.extend(kept.transpose(0, 1).contiguous().view(-1))
        self.steps += length

    def state_dict(self) -> dict[str, Any]:
        """Return the rows that are kept, and where the ring is."""
        return {"buffer": self.buffer.state_dict(), "episode": self._episode, "steps": self.steps}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`.

        Raises:
            StateError: when it is of another number of robots or steps, or of other entries.
        """
        if (robots := len(state["episode"])) != self.num_envs:
            raise StateError(f"replay: a state of {counted(robots, 'robot')}, expected {self.num_envs}")
        rows = state["buffer"]["_storage"]["_storage"]
        kept = {name.partition(".")[0] for name in rows} - {"episode", "index"}
        wanted = {key if isinstance(key, str) else key[0] for key in self._keys}
        if rows and kept != wanted:
            raise StateError(f"replay: a state of {', '.join(sorted(kept))}, expected {', '.join(sorted(wanted))}")
        self.buffer.load_state_dict(state["buffer"])
        self._episode = state["episode"].to(self._episode.device)
        self.steps = int(state["steps"])

    def windows(self, batch: int, length: int) -> TensorDictBase:
        """Sample windows ``[batch, length]`` of successive steps of one episode; fewer where most episodes are shorter.

        Args:
            batch: number of windows.
            length: control steps of each.

        Raises:
            ConfigError: when there are fewer steps than that, all episodes are shorter, or an argument is no count.
        """
        check_value("replay: batch", batch, Count)
        check_value("replay: length", length, Count)
        self._sampler.length = length
        return self.buffer.sample(batch * length).view(-1, length)

    def states(self, batch: int, recent: int | None = None) -> TensorDictBase:
        """Sample single steps ``[batch]`` of the last ``recent`` control steps.

        Raises:
            ConfigError: when there are none, or an argument is no count.
        """
        check_value("replay: batch", batch, Count)
        check_value("replay: recent", recent, Count | None)
        self._recent_sampler.recent = recent
        return self._recent.sample(batch)


class WindowSampler(Sampler):
    """Sampler of windows: successive steps of one robot within one episode.

    Args:
        replay: whose storage is drawn from.
    """

    def __init__(self, replay: RolloutReplay):
        self._replay = replay
        self.length = 1
        """Control steps of a window."""
        self.recent: int | None = None
        """Last control steps that windows are from; None for all."""

    def sample(self, storage: Storage, batch_size: int) -> tuple[Tensor, dict[str, Any]]:
        """Sample rows ``[B * length]``, window after window, with ``B * length <= batch_size``."""
        replay, wanted = self._replay, batch_size // self.length
        span = min(len(replay), self.recent or len(replay))
        if span < self.length:
            raise ConfigError(f"replay: {counted(span, 'control step')}, expected at least a window of {self.length}")
        # windows with an end in them are rejected: the spare ones suffice for episodes of a few windows' length
        drawn = wanted if self.length == 1 else wanted + wanted // 2 + 8
        device = replay._episode.device
        first = replay.steps - span + torch.randint(span - self.length + 1, (drawn,), device=device)
        robot = torch.randint(replay.num_envs, (drawn,), device=device)
        time = (first[:, None] + torch.arange(self.length, device=device)) % replay.capacity
        rows = time * replay.num_envs + robot[:, None]
        if self.length > 1:
            episode = storage._storage["episode"]
            whole = episode[rows[:, 0]] == episode[rows[:, -1]]
            if not whole.any():
                raise ConfigError(
                    f"replay: no {self.length} successive steps of an episode were found, expected episodes longer "
                    "than that, or a shorter window"
                )
            rows = rows[whole][:wanted]
        return rows.flatten(), {}

    def _empty(self) -> None:
        pass

    def dumps(self, path: Any) -> None:
        """Do nothing: there is no state to write."""

    def loads(self, path: Any) -> None:
        """Do nothing: there is no state to read."""

    def state_dict(self) -> dict[str, Any]:
        """Return nothing: there is no state."""
        return {}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Do nothing: there is no state."""
