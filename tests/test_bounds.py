from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pytest

from plat.bounds import Ascending, Bounded, Count, Fraction, Layers, NotEmpty, Positive, Range, Seed, Within
from plat.envs.part_masks import draw_parts
from plat.errors import ConfigError, RobotError
from plat.evaluation.study import StudyPlan
from plat.keyframes import KeyframeSequence, standing
from plat.motions import MotionLibrary, generate_motions, save_motions
from plat.robots import G1, ForwardKinematics, describe_robot, register_robot
from plat.runs.user_modules import import_modules
from plat.spec.observation import observation_size, student_keys
from plat.spec.parts import Parts
from plat.tasks import draw_chains


@dataclass(frozen=True)
class Inner(Bounded):
    share: Fraction = 0.5


@dataclass(frozen=True, kw_only=True)
class Settings(Bounded):
    count: Count = 3
    rate: Positive = 1.0
    seed: Seed = 0
    hold: Annotated[float, Range(0, infinite=True)] = 0.0
    layers: Layers = (8,)
    ends: Within = (0.0, 1.0)
    limit: Positive | None = None
    names: Annotated[tuple[str, ...], NotEmpty()] = ("a",)
    mode: Literal["fast", "slow"] = "fast"
    flag: bool = False
    out: Path = Path()
    inner: Inner = field(default_factory=Inner)
    plain: float = 0.0
    decay: Annotated[float, Range(0, 1, below=True)] = 0.9


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"count": 0}, "count is 0, expected a whole number of at least 1"),
        ({"count": 2.0}, "count is 2.0, expected a whole number"),
        ({"count": True}, "count is True, expected a whole number"),
        ({"rate": float("nan")}, "rate is nan, expected a number above 0"),
        ({"rate": float("inf")}, "rate is inf, expected a number above 0"),
        ({"rate": "1"}, "rate is '1', expected a number"),
        ({"rate": 10**400}, "rate is 1000.*000, expected a number above 0"),
        ({"rate": 10**5000}, "rate is a number of thousands of digits, expected a number above 0"),
        ({"hold": 10**400}, "hold is 1000.*000, expected a number of at least 0"),
        ({"plain": -(10**400)}, "plain is -1000.*000, expected a number"),
        ({"ends": (0.0, 10**400)}, r"ends is \(0.0, 1000.*000\), expected 2 values"),
        ({"seed": 2**70}, "seed is 1180591620717411303424, expected a whole number from 0 to 4,294,967,295"),
        ({"hold": float("nan")}, "hold is nan"),
        ({"layers": (8, 0)}, r"layers is \(8, 0\), expected a tuple, each a whole number from 1 to 65,536"),
        ({"layers": 8}, "layers is 8, expected a tuple"),
        ({"ends": (2.0, 1.0)}, "ends is .* expected 2 values, each a number of at least 0 in ascending order"),
        ({"ends": (1.0,)}, "ends is .* expected 2 values"),
        ({"limit": -1.0}, "limit is -1.0, expected a number above 0 or None"),
        ({"names": ()}, r"names is \(\), expected a tuple, each a text and at least one"),
        ({"names": "abc"}, "names is 'abc', expected a tuple"),
        ({"mode": "slower"}, "mode is 'slower', expected one of fast, slow"),
        ({"flag": 1}, "flag is 1, expected True or False"),
        ({"out": "runs"}, "out is 'runs', expected a path"),
        ({"inner": 0.5}, "inner is 0.5, expected an Inner"),
        ({"plain": float("nan")}, "plain is nan, expected a number"),
        ({"decay": 1.0}, "decay is 1.0, expected a number of at least 0 and below 1"),
    ],
)
def test_values_without_sense_are_refused(values, message):
    with pytest.raises(ConfigError, match=f"^Settings: {message}") as error:
        Settings(**values)
    assert "\n" not in str(error.value)


def test_values_with_sense_are_taken():
    for values in ({"hold": float("inf")}, {"limit": 2}, {"layers": ()}, {"layers": [4, 4]}, {"ends": (1, 1)}):
        Settings(**values)
    Settings(count=np.int64(3), rate=np.float32(0.5), seed=2**32 - 1)


def test_nested_settings_say_their_own_name():
    with pytest.raises(ConfigError, match="Inner: share is 1.5, expected a number from 0 to 1"):
        Settings(inner=Inner(1.5))


def test_bounds_hold_for_classes_that_inherit():
    @dataclass(frozen=True)
    class More(Inner):
        extra: Annotated[tuple[float, ...], Ascending()] = ()

    with pytest.raises(ConfigError, match="More: share is -1"):
        More(share=-1)
    with pytest.raises(ConfigError, match="More: extra"):
        More(extra=(2.0, 1.0))


def test_a_single_name_stands_for_a_tuple_of_one():
    for one, several in (
        (student_keys("clock"), student_keys(("clock",))),
        (Parts.only(G1, root="height"), Parts.only(G1, root=("height",))),
        (draw_parts(G1, 3, kinds="hands").tolist(), draw_parts(G1, 3, kinds=("hands",)).tolist()),
        (StudyPlan(horizons="long", longer="3s"), StudyPlan(horizons=("long",), longer=("3s",))),
    ):
        assert one == several
    assert [clip.name for clip in generate_motions("val", seconds=4, families="walk")] == ["walk_val_000"]
    import_modules("json")


def test_the_name_of_a_robot_in_its_place_is_told():
    pose, clip = standing(G1), generate_motions("val", seconds=4)[0]
    for door in (
        standing,
        pose.checked,
        clip.check,
        ForwardKinematics,
        register_robot,
        lambda robot: Parts.only(robot, joints=["left_knee"]),
        lambda robot: KeyframeSequence(robot, pose, (pose.at(0.5),)),
        lambda robot: KeyframeSequence.load("wave.json", robot),
        lambda robot: save_motions("a.npz", [clip], robot),
        lambda robot: MotionLibrary.from_clips([clip], robot),
        lambda robot: generate_motions("val", seconds=4, robot=robot),
        lambda robot: observation_size(student_keys(), robot),
        lambda robot: describe_robot(robot, 0.02),
    ):
        with pytest.raises(RobotError, match=r"robot is 'g1', expected a Robot, as plat.robots.get_robot\('g1'\)"):
            door("g1")


def test_motions_in_the_place_of_a_library_are_told():
    with pytest.raises(ConfigError, match="library is 'walk.npz', expected a MotionLibrary"):
        draw_chains("walk.npz", 3)
