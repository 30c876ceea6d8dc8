"""Velocity feed-forward of goals against the lag of the motors."""

from collections.abc import Sequence
from typing import Annotated

import torch
from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

from plat.bounds import NonNegative, NotEmpty, Positive, check_value
from plat.entries import Shape, expects
from plat.errors import ConfigError
from plat.gpu import HORIZONTAL, constant
from plat.spec.observation import Entry, as_entries, entries_of, quantities

__all__ = [
    "LEAD_KEYS",
    "GoalLead",
    "KeyframeLead",
    "KeyframeShift",
    "led",
    "moved_keyframe",
]

LEAD_KEYS = ("root_pos_b", "keypoint_pos_b")
"""Entries of a goal that :class:`GoalLead` and :class:`KeyframeLead` move."""


def led(keys: Sequence[NestedKey], lead: TensorDictModule) -> list[NestedKey]:
    """Return the keys, with the moved entries in place of those that a lead moves.

    >>> led([("goal", "root_pos_b"), ("goal", "joint_pos")], KeyframeLead(0.05, horizon=1.0))
    [('led_goal', 'root_pos_b'), ('goal', 'joint_pos')]
    """
    moved = dict(zip(lead.in_keys, lead.out_keys, strict=False))
    return [moved.get(key, key) for key in keys]


class GoalLead(TensorDictModule):
    """Velocity feed-forward and proportional gain on the positions of the reference frames.

    A tracker whose motors have stiffness and damping lags by about ``kd/kp``. Walking at 2 m/s it trails its reference
    by 14 cm, and a reward on the position hardly changes that. Here all its frames are shifted by

    ``lead * v + gain * d``

    with ``v`` the reference's root velocity, from the first two frames, and ``d`` the way along the x and y axes of
    the robot's root to the first frame's, of at most ``limit``. These axes are those of the root as it is tilted: they
    are level only where it is upright. A keyframe in the place of all frames has no velocity. Nothing else of a goal
    changes. It writes to groups of its own: :data:`LEAD_KEYS` of ``"led_goal"`` for ``"goal"``.

    Args:
        groups: goal groups, the first two of them ``interval`` apart.
        lead: time (s).
        gain: without unit.
        interval: time from the first frame to the second (s).
        limit: longest ``d`` (m).

    Raises:
        ConfigError: for a lead with less than two groups, and times or lengths that make no sense.

    >>> lead = GoalLead(("goal", "goal_2"), lead=0.1, gain=1.0, interval=0.02)
    >>> lead.out_keys[:2]
    [('led_goal', 'root_pos_b'), ('led_goal', 'keypoint_pos_b')]
    """

    def __init__(self, groups: Sequence[str], lead: float, gain: float, interval: float, limit: float = 0.3):
        for name, value, hint in (
            ("lead", lead, NonNegative),
            ("gain", gain, NonNegative),
            ("interval", interval, Positive),
            ("limit", limit, NonNegative),
            ("groups", tuple(groups), Annotated[tuple[str, ...], NotEmpty()]),
        ):
            check_value(f"lead: {name}", value, hint)
        if lead and len(groups) < 2:
            raise ConfigError(f"lead is {lead:g} s: the reference's velocity takes two frames")
        in_keys: list[NestedKey] = [(group, key) for group in groups for key in LEAD_KEYS]
        out_keys: list[NestedKey] = [(f"led_{group}", key) for group in groups for key in LEAD_KEYS]
        shift = _Shift(lead / interval, gain, limit, entries_of(in_keys))
        super().__init__(shift, in_keys=in_keys, out_keys=out_keys)
        expects(self, {key: (3,) if key[-1] == LEAD_KEYS[0] else ("3 K",) for key in in_keys}, "lead")


class KeyframeLead(TensorDictModule):
    """Velocity feed-forward on the keyframe, along the mean velocity that arrives on time.

    A policy that lags arrives late. Its keyframe is shifted by ``lead * d / max(t, shortest)``, with ``d`` the way
    to the keyframe's root along the x and y axes of the robot's, as it is tilted, and ``t`` the time left.
    :class:`GoalLead` does the same with the velocity of a reference. What a partial keyframe does not command stays 0,
    and where it commands no horizontal position nothing is moved.

    Args:
        lead: time (s).
        horizon: longest time to a keyframe (s), in units of which ``("command", "horizon")`` is.
        shortest: lower bound on the time left (s); without it the keyframe would swing in the last steps.
        group: that the keyframe is read from.
        parts: whether the policy sees which parts are commanded (group ``"parts"``).

    Raises:
        ConfigError: for times that make no sense.

    >>> lead = KeyframeLead(0.05, horizon=1.0)
    >>> lead.out_keys
    [('led_goal', 'root_pos_b'), ('led_goal', 'keypoint_pos_b')]
    """

    def __init__(self, lead: float, horizon: float, shortest: float = 0.1, group: str = "goal", parts: bool = False):
        check_value("lead: lead", lead, NonNegative)
        check_value("lead: horizon", horizon, Positive)
        check_value("lead: shortest", shortest, Positive)
        in_keys: list[NestedKey] = [
            *((group, key) for key in LEAD_KEYS),
            ("command", "horizon"),
            *([("parts", "bodies"), ("parts", "root")] if parts else []),
        ]
        out_keys: list[NestedKey] = [("led_goal", key) for key in LEAD_KEYS]
        shift = KeyframeShift(lead / horizon, shortest / horizon, entries_of(in_keys))
        super().__init__(shift, in_keys=in_keys, out_keys=out_keys)
        shapes: tuple[Shape, ...] = ((3,), ("3 K",), (1,), ("K",), (3,))
        expects(self, dict(zip(in_keys, shapes, strict=False)), "lead")


class KeyframeShift(nn.Module):
    """Shift of :class:`KeyframeLead`, with times in units of the horizon.

    Args:
        lead: time.
        shortest: lower bound on the time left.
        entries: of the table, of what it is given.

    Attributes:
        scaled: whether the table scales one of them.
    """

    def __init__(self, lead: float, shortest: float, entries: Sequence[Entry]):
        super().__init__()
        self.lead = lead
        self.shortest = shortest
        self._entries = tuple(entries)
        self.scaled = any(entry.scale != 1.0 for entry in entries)

    def share(self, time_left: Tensor) -> Tensor:
        """Return the fraction of the way to it by which a keyframe is moved ``[*B, 1]``."""
        return self.lead / time_left.clamp_min(self.shortest)

    def forward(self, *observed: Tensor) -> tuple[Tensor, ...]:
        """Return the moved positions of root ``[*B, 3]`` and keypoints ``[*B, 3 K]``, as they are observed."""
        root, keypoints, time_left, *parts = quantities(self._entries, observed)
        bodies, commanded = parts or (None, None)
        shift = root * self.share(time_left) * constant(HORIZONTAL, root)
        return as_entries(self._entries, moved_keyframe(root, keypoints, shift, bodies, commanded))


def moved_keyframe(
    root: Tensor, keypoints: Tensor, shift: Tensor, bodies: Tensor | None, commanded: Tensor | None
) -> tuple[Tensor, Tensor]:
    """Return root ``[*B, 3]`` and keypoints ``[*B, 3 K]`` moved by a shift, as far as they are commanded.

    Args:
        root, keypoints: positions in the robot's root frame (m).
        shift: ``[*B, 3]`` (m), along x and y of the robot's root, which are level only where it is upright.
        bodies: which keypoints are commanded ``[*B, K]``; None for all.
        commanded: which parts of the root are ``[*B, 3]``, its horizontal position first; None for all.
    """
    if commanded is not None:  # the way to a height alone is not level in a root that leans
        shift = shift * commanded[..., :1]
    moved = shift.unsqueeze(-2)
    if bodies is not None:
        moved = moved * bodies.unsqueeze(-1)
    return root + shift, (keypoints.unflatten(-1, (-1, 3)) + moved).flatten(-2)


class _Shift(nn.Module):
    def __init__(self, frames: float, gain: float, limit: float, entries: Sequence[Entry]):
        super().__init__()
        self._entries = tuple(entries)
        self.frames = frames
        self.gain = gain
        self.limit = limit

    def forward(self, *observed: Tensor) -> tuple[Tensor, ...]:
        positions = quantities(self._entries, observed)
        first = positions[0]
        way = torch.nn.functional.pad(first[..., :2], (0, 1))
        too_long = (self.limit / way.norm(dim=-1, keepdim=True).clamp_min(1e-6)).clamp_max(1.0)
        shift = self.gain * too_long * way
        if self.frames:
            # two entries a frame: the second frame's root is the third
            shift = shift + self.frames * (positions[2] - first)
        moved = [(position.unflatten(-1, (-1, 3)) + shift.unsqueeze(-2)).flatten(-2) for position in positions]
        return as_entries(self._entries, moved)
