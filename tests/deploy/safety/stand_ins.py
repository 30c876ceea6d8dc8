"""Stand-ins for a policy, a source of commands, and states of a robot."""

from dataclasses import replace

import numpy as np

from plat.deploy import RobotState
from plat.errors import ActionError
from plat.spec.timing import Timing
from tests.deploy.robots import SomePose, describe_g1

ROBOT = describe_g1()
DT = ROBOT.control_dt


def good_state(shift: float = 0.0) -> RobotState:
    """The robot in its default pose, with joints moved by an angle."""
    still = np.zeros(3)
    place = np.array([0.0, 0.0, ROBOT.root_height])
    return RobotState(
        ROBOT.default_joint_pos + shift, np.zeros(29), place, np.array([1.0, 0, 0, 0]), still, still + 1e-3 * shift
    )


class StandIn:
    """A policy that answers what a function says; by default the keyframe's joints."""

    def __init__(self, answer=None):
        self.robot, self.timing = ROBOT, Timing()
        self.answer = answer or (lambda state, keyframe, steps_left: keyframe.joint_pos)
        self.asked: list[tuple] = []

    def reset(self, joint_target=None) -> None:
        self.asked.clear()

    def __call__(self, state, keyframe, steps_left):
        self.asked.append((state, keyframe, steps_left))
        return self.answer(state, keyframe, steps_left)


class Commands:
    """A source of one keyframe, commanded for some seconds."""

    def __init__(self, seconds: float = 1e9, joint_pos=None):
        self.seconds = seconds
        self.pose = SomePose(np.concatenate((ROBOT.default_qpos[:7], ROBOT.default_joint_pos)))
        if joint_pos is not None:
            self.pose.joint_pos = joint_pos
        self.root_pos, self.root_quat = self.pose.root_pos, self.pose.root_quat

    def command(self, time):
        from types import SimpleNamespace

        left = round((self.seconds - time) / DT)
        return SimpleNamespace(keyframe=self.pose, steps_left=min(left, 50)) if left > 0 else None


class HostileStates:
    """States that a broken robot, driver or network might send: every kind, in bursts between good ones."""

    KINDS = ("good", "nan", "infinite", "huge", "jump", "frozen", "order", "old", "future", "missing", "shape", "list",
             "quaternion", "fallen", "integers")  # fmt: skip

    def __init__(self, seed: int):
        self._random = np.random.default_rng(seed)
        self._kind, self._left = "good", 200
        self._last = good_state()

    def __call__(self, now: float):
        """Return a state, and the time that it claims."""
        if self._left == 0:
            good = self._random.random() < 0.4
            self._kind = "good" if good else str(self._random.choice(self.KINDS))
            self._left = int(self._random.integers(5, 80)) if good else int(self._random.integers(1, 12))
        self._left -= 1
        random, kind = self._random, self._kind
        state = good_state()
        state.joint_pos = state.joint_pos + 0.02 * random.standard_normal(29)
        state.joint_vel = random.standard_normal(29)
        if kind == "good":
            self._last = state
            return state, now
        field = str(random.choice(list(vars(state))))
        values = getattr(state, field).copy()
        where = random.integers(len(values))
        if kind in ("nan", "infinite", "huge", "quaternion"):
            values[where] = {"nan": np.nan, "infinite": -np.inf, "huge": 1e300, "quaternion": 7.0}[kind]
            return replace(state, **{field if kind != "quaternion" else "root_quat_w": values}), now
        if kind == "jump":
            return replace(state, joint_pos=ROBOT.joint_range[:, random.integers(2)] + random.normal(0, 0.2)), now
        if kind == "fallen":
            return replace(state, root_quat_w=np.array([0.5**0.5, 0, 0.5**0.5, 0])), now
        if kind == "shape":
            return replace(state, **{field: values[:-1]}), now
        if kind == "list":
            return replace(state, **{field: values.tolist()}), now
        if kind == "integers":
            return replace(state, joint_pos=np.zeros(29, dtype=np.int64)), now
        stamps = {"order": now - 0.03, "old": now - 5.0, "future": now + 3.0, "frozen": now}
        return (None, None) if kind == "missing" else (self._last if kind == "frozen" else state, stamps[kind])


def hostile_policy(seed: int) -> StandIn:
    """A policy whose targets are anything, and that fails now and then."""
    random = np.random.default_rng(seed)

    def answer(state, keyframe, steps_left):
        kind = random.integers(8)
        target = ROBOT.default_joint_pos + random.normal(0, 10.0 ** random.integers(-2, 5), 29)
        if kind == 0:
            target[random.integers(29)] = random.choice([np.nan, np.inf, -1e308])
        if kind == 1:
            raise ActionError("broken")
        if kind == 2:
            return target[:7]
        return target

    return StandIn(answer)
