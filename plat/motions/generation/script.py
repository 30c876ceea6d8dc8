"""Motion script: channels and footsteps over time, before legs and balance are solved."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plat.motions.generation.interpolation import fade, minimum_jerk, moves, quintic

__all__ = ["LEFT", "RIGHT", "SIDES", "SOLE_CENTER", "Draft", "MotionScript"]

LEFT, RIGHT = 0, 1
SIDES = ("left", "right")
SOLE_CENTER = 0.035
"""How far the middle of the sole lies before the ankle (m)."""


@dataclass
class Draft:
    """Sampled script: channels, feet and zero-moment point over time.

    Attributes:
        time: ``[F]`` (s).
        channels: value ``[F]`` of every channel that is not 0 throughout, by name; see :class:`MotionScript`.
        foot_pos: x, y and height (m) of the left and right sole at the ankle, were the foot flat ``[F, 2, 3]``.
        foot_yaw: ``[F, 2]`` (rad).
        zmp: wanted zero-moment point ``[F, 2]`` (m).
        com_rise: height of the center of mass over that of the first frame ``[F]`` (m), where the script gives it;
            None leaves it to ``pelvis_height`` and the legs.
    """

    time: np.ndarray
    channels: dict[str, np.ndarray]
    foot_pos: np.ndarray
    foot_yaw: np.ndarray
    zmp: np.ndarray
    com_rise: np.ndarray | None = None

    def channel(self, name: str) -> np.ndarray:
        """Return the value ``[F]`` of any channel."""
        return self.channels.get(name, np.zeros(len(self.time)))


@dataclass(frozen=True)
class _Swing:
    foot: int
    begin: float
    duration: float
    change: np.ndarray  # of x, y (m) and yaw (rad)
    clearance: float
    snatched: bool


class MotionScript:
    """Motion script, written from start to end; ``now`` is the current time of writing.

    Channels, each with a resting value (``home``, else 0) that the motion starts from:

    - joints of waist and arms by name (rad);
    - ``pelvis_height`` (m, relative to the default pose), ``pelvis_roll``, ``pelvis_pitch``, ``pelvis_yaw`` (rad,
      relative to the heading of the feet);
    - ``left_foot_up``, ``left_foot_forward``, ``left_foot_sideways`` (m, relative to where the foot stands, along
      its own heading), ``left_foot_pitch`` (rad; positive lifts the heel and turns about the toe, negative lifts
      the toe and turns about the heel), and the same of the right foot.

    Args:
        stance: x, y (m) and yaw (rad) of the left and right foot ``[2, 3]``.
        home: resting values.

    >>> script = MotionScript(np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]]), {"left_elbow": 0.6})
    >>> script.move({"left_elbow": 1.0}, 0.5)
    >>> script.wait(1.0)
    >>> script.draft(dt=0.5).channels["left_elbow"].tolist()
    [0.6, 1.0, 1.0]
    """

    def __init__(self, stance: np.ndarray, home: Mapping[str, float]):
        self.feet = np.array(stance, dtype=np.float64)
        """Where each foot stands after all that is written ``[2, 3]``."""
        self.home = dict(home)
        self.now = 0.0
        self._value = dict(home)
        self._changes: dict[str, list[tuple[float, float, float]]] = defaultdict(list)
        self._waves: list[tuple[str, np.ndarray]] = []
        self._arm_swings: list[tuple[float, float, float]] = []
        self._swings: list[_Swing] = []
        self._start = self.feet.copy()
        self._weight: list[tuple[float, np.ndarray]] = [(0.0, self.under(0.5))]
        self._rises: list[tuple[float, float, float, float]] = []

    def under(self, right: float, forward: float = 0.0) -> np.ndarray:
        """Return a point on the floor ``[2]`` (m) between the middles of the soles, ``right`` 0..1 of the way to the
        right.

        ``forward`` (m) shifts it along the heading of the feet.
        """
        heading = np.stack((np.cos(self.feet[:, 2]), np.sin(self.feet[:, 2])), -1)
        soles = self.feet[:, :2] + (SOLE_CENTER + forward) * heading
        return soles[LEFT] + right * (soles[RIGHT] - soles[LEFT])

    def wait(self, seconds: float) -> None:
        """Advance the time of writing."""
        self.now += seconds

    def move(self, targets: Mapping[str, float], seconds: float, delay: float = 0.0) -> None:
        """Move channels to new values, beginning ``delay`` seconds from now; time does not advance."""
        for channel, target in targets.items():
            change = target - self._value.get(channel, 0.0)
            self._changes[channel].append((self.now + delay, seconds, change))
            self._value[channel] = target

    def shift(self, changes: Mapping[str, float], seconds: float, delay: float = 0.0) -> None:
        """Move channels by amounts relative to the resting values; see :meth:`move`."""
        self.move({name: self.home.get(name, 0.0) + change for name, change in changes.items()}, seconds, delay)

    def rest(self, seconds: float, delay: float = 0.0) -> None:
        """Move every channel back to its resting value."""
        self.shift(dict.fromkeys(self._value, 0.0), seconds, delay)

    def wave(
        self, channel: str, amplitude: float, frequency: float, seconds: float, phase: float = 0.0, edge: float = 0.5
    ) -> None:
        """Add ``amplitude * sin(2 pi frequency t + phase)`` for some seconds from now, faded in and out."""
        self._waves.append((channel, np.array([self.now, seconds, amplitude, frequency, phase, edge])))

    def swing_arms(self, gain: float, begin: float) -> None:
        """Swing each arm with the opposite foot, from ``begin`` (s) until now: ``gain`` rad per meter."""
        self._arm_swings.append((begin, self.now, gain))

    def weigh(self, point: np.ndarray, seconds: float, delay: float = 0.0) -> None:
        """Move the weight (the zero-moment point) to a point on the floor ``[2]`` at a steady speed."""
        begin = self.now + delay
        self._weight += [(begin, self._weight[-1][1]), (begin + seconds, np.asarray(point))]

    def rise(self, height: float, speed: float = 0.0, acceleration: float = 0.0, delay: float = 0.0) -> None:
        """Pass the center of mass through a height (m, over the start) with a speed (m/s) and acceleration (m/s^2).

        Knots are joined by polynomials of fifth degree. Between two knots of free fall that is the parabola of a
        flight. A script with any knot gives the height of the center of mass throughout.
        """
        self._rises.append((self.now + delay, height, speed, acceleration))

    def step(
        self,
        foot: int,
        place: np.ndarray,
        seconds: float,
        clearance: float,
        delay: float = 0.0,
        snatched: bool = False,
    ) -> None:
        """Move a foot to x, y (m) and yaw (rad) ``[3]``; the sole rises to ``clearance`` (m) on the way.

        A snatched foot leaves the floor and comes down fast, as in running and jumping.
        """
        change = np.asarray(place) - self.feet[foot]
        self._swings.append(_Swing(foot, self.now + delay, seconds, change, clearance, snatched))
        self.feet[foot] = place

    def draft(self, dt: float) -> Draft:
        """Sample the script every ``dt`` seconds."""
        time = np.arange(round(self.now / dt) + 1) * dt
        place = np.repeat(self._start[None], len(time), 0)
        up = np.zeros((len(time), 2))
        for swing in self._swings:
            progress = ((time - swing.begin) / swing.duration).clip(0, 1)
            if swing.snatched:
                place[:, swing.foot] += (progress**2 * (3 - 2 * progress))[:, None] * swing.change
                up[:, swing.foot] += swing.clearance * (4 * progress * (1 - progress)) ** 1.5
            else:
                place[:, swing.foot] += minimum_jerk(progress)[:, None] * swing.change
                up[:, swing.foot] += swing.clearance * 16 * (progress * (1 - progress)) ** 2
        names = sorted({*self.home, *self._changes, *(channel for channel, _ in self._waves)})
        channels = {name: moves(time, self.home.get(name, 0.0), self._changes[name]) for name in names}
        for channel, (begin, seconds, amplitude, frequency, phase, edge) in self._waves:
            beat = np.sin(2 * np.pi * frequency * (time - begin) + phase)
            channels[channel] = channels[channel] + amplitude * fade(time, begin, begin + seconds, edge) * beat
        self._follow_feet(time, place, channels)
        for foot, side in enumerate(SIDES):
            ahead, aside = (channels.get(f"{side}_foot_{way}", np.zeros(1)) for way in ("forward", "sideways"))
            sine, cosine = np.sin(place[:, foot, 2]), np.cos(place[:, foot, 2])
            place[:, foot, 0] += cosine * ahead - sine * aside
            place[:, foot, 1] += sine * ahead + cosine * aside
            up[:, foot] += channels.get(f"{side}_foot_up", np.zeros(1))
        knots, points = np.array([knot for knot, _ in self._weight]), np.array([point for _, point in self._weight])
        zmp = np.stack([np.interp(time, knots, points[:, axis]) for axis in range(2)], -1)
        rise = quintic(time, [(0.0, 0.0, 0.0, 0.0), *self._rises]) if self._rises else None
        return Draft(time, channels, np.concatenate((place[..., :2], up[..., None]), -1), place[..., 2], zmp, rise)

    def _follow_feet(self, time: np.ndarray, place: np.ndarray, channels: dict[str, np.ndarray]) -> None:
        between, yaw = place[:, LEFT, :2] - place[:, RIGHT, :2], place[..., 2].mean(-1)
        lead = np.cos(yaw) * between[:, 0] + np.sin(yaw) * between[:, 1]  # of the left foot, along the heading
        for begin, end, gain in self._arm_swings:
            swing = gain * lead * fade(time, begin, end, 0.6)
            for channel, sign in (("left_shoulder_pitch", 1.0), ("right_shoulder_pitch", -1.0), ("waist_yaw", 0.25)):
                channels[channel] = channels.get(channel, np.zeros(len(time))) + sign * swing
