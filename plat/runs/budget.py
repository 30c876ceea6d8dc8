"""Training budget in minutes or environment steps, with an estimate of the time left."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from plat.errors import PlatError

__all__ = ["Budget"]


class Budget:
    """Training budget: counts steps and seconds against a limit.

    Args:
        minutes: wall-clock minutes of training, counted over all resumed parts, without pauses.
        steps: environment steps, counted over all robots and resumed parts. The first limit that is reached counts.

    Raises:
        PlatError: when there is no limit or one is not positive.

    >>> budget = Budget(steps=100)
    >>> budget.add(60)
    >>> budget.done, budget.fraction
    (False, 0.6)
    """

    def __init__(self, minutes: float | None = None, steps: int | None = None):
        limits = [limit for limit in (minutes, steps) if limit is not None]
        if not limits or not all(0 < limit < float("inf") for limit in limits):
            raise PlatError(f"budget: --minutes {minutes}, --steps {steps}; expected a positive number for one of them")
        self._minutes_limit = minutes
        self._steps_limit = steps
        self.steps = 0
        """Environment steps so far."""
        self._seconds_before = 0.0
        self._started = time.monotonic()
        self._ended: float | None = None
        self._steps_before = 0

    @property
    def seconds(self) -> float:
        """Return the seconds of training so far."""
        now = time.monotonic() if self._ended is None else self._ended
        return self._seconds_before + now - self._started

    @property
    def rate(self) -> float:
        """Return environment steps per second since this process began."""
        return (self.steps - self._steps_before) / max(time.monotonic() - self._started, 1e-9)

    @property
    def fraction(self) -> float:
        """Return the fraction of the budget that is spent."""
        shares = []
        if self._minutes_limit is not None:
            shares.append(self.seconds / (60 * self._minutes_limit))
        if self._steps_limit is not None:
            shares.append(self.steps / self._steps_limit)
        return max(shares)

    @property
    def done(self) -> bool:
        """Return whether the budget is spent, on one iteration at least."""
        return self.steps > 0 and self.fraction >= 1

    @property
    def seconds_left(self) -> float:
        """Estimate the seconds left from the rate so far; infinite before the first step."""
        estimates = []
        if self._minutes_limit is not None:
            estimates.append(60 * self._minutes_limit - self.seconds)
        if self._steps_limit is not None:
            left = self._steps_limit - self.steps
            estimates.append(left / self.rate if self.rate > 0 else float("inf"))
        return max(0.0, min(estimates))

    def begin(self) -> None:
        """Count seconds from now on: starting workers is no training."""
        self._started, self._ended = time.monotonic(), None

    def end(self) -> None:
        """Count no seconds from now on: a report on what was trained is no training."""
        self._ended = time.monotonic()

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Count no seconds, as a context: a video or a checkpoint is no training."""
        running, began = self._ended is None, time.monotonic()
        if running:
            self._ended = began
        try:
            yield
        finally:
            if running:
                self._started, self._ended = self._started + time.monotonic() - began, None

    def add(self, steps: int) -> None:
        """Count environment steps."""
        self.steps += steps

    def state_dict(self) -> dict[str, float]:
        """Return the state from which a resumed run continues."""
        return {"steps": self.steps, "seconds": self.seconds}

    def load_state_dict(self, state: dict[str, float]) -> None:
        """Restore a state of :meth:`state_dict`."""
        self.steps = self._steps_before = int(state["steps"])
        self._seconds_before = float(state["seconds"])
        self.begin()
