from dataclasses import replace

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions.retargeting import builtin_maps, read_bvh, retarget
from plat.motions.retargeting.builtin import find_map, joint_keys
from plat.motions.retargeting.mocap import Mocap
from plat.motions.retargeting.propose import propose_map
from plat.motions.retargeting.skeletons import ROLES, SkeletonMap

from .human import write_human

MAPS = {skeleton.name: skeleton for skeleton in builtin_maps()}
LAFAN1 = MAPS["lafan1"]


def bare(names: list[str]) -> Mocap:
    """A capture of one frame with these joints, all at different places."""
    places = np.random.default_rng(0).normal(size=(1, len(names), 3))
    parents = tuple(range(-1, len(names) - 1))
    return Mocap(tuple(names), parents, places, np.zeros((1, len(names), 3, 3)), 30.0, places[0])


def renamed(tmp_path, **names: str) -> Mocap:
    """The human of the tests with other names of joints, by the names of LAFAN1."""
    return read_bvh(write_human(tmp_path / "a.bvh", frames=3, names=names))


def as_named(skeleton: SkeletonMap) -> dict[str, str]:
    """The names of a map for those of LAFAN1, and names that mean nothing for what has no role."""
    rest = ("Spine1", "Head", "LeftShoulder", "RightShoulder")
    nothing = {name: f"Extra{number}" for number, name in enumerate(rest) if name not in LAFAN1.joints.values()}
    return {**nothing, **{LAFAN1.joints[role]: skeleton.joints[role] for role in ROLES}}


@pytest.mark.parametrize("name", sorted(MAPS))
def test_every_map_finds_its_own_joints(name):
    found = find_map(bare(list(dict.fromkeys([*MAPS[name].joints.values(), "Tail"]))), "a.bvh")
    # maps of one layout are told apart by the height of the chest, and these have one joint for two roles
    assert set(found.joints.values()) <= set(MAPS[name].joints.values())


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda name: f"mixamorig:{name}", "mixamo"),
        (lambda name: f"mixamorig1:{name}", "mixamo"),
        (lambda name: f"Character2_{name}", "mixamo"),
        (lambda name: f"Take|Actor:{name}", "mixamo"),
        (lambda name: f"{name}_jnt", "mixamo"),
        (lambda name: f"{name}Joint", "mixamo"),
        (str.upper, "mixamo"),
        (str.lower, "mixamo"),
        (lambda name: f"Skeleton 01-{name}".replace("Skeleton 01-", "Skeleton_"), "mixamo"),
    ],
)
def test_prefixes_case_and_separators_do_not_matter(tmp_path, change, expected):
    names = {name: change("LeftToeBase" if name == "LeftToe" else name) for name in LAFAN1.joints.values()}
    names |= {"RightToe": change("RightToeBase"), "Spine1": change("Spine1"), "Head": change("Head")}
    names |= {f"{side}Shoulder": change(f"{side}Shoulder") for side in ("Left", "Right")}
    mocap = renamed(tmp_path, **names)
    found = find_map(mocap, "a.bvh")
    assert found.name == expected
    assert found.joints["chest"] == change("Spine2")
    assert set(found.joints.values()) <= set(mocap.names)


@pytest.mark.parametrize(
    "name", ["rokoko", "xsens", "xsens_mvn", "soma", "optitrack", "amass", "smpl", "biped", "unreal"]
)
def test_what_people_have_is_retargeted(tmp_path, name):
    pytest.importorskip("mink")
    path = write_human(tmp_path / "a.bvh", frames=5, names=as_named(MAPS[name]))
    result = retarget(path)
    assert result.error < 0.01
    assert f"map {name}" in result.clip.notes
    assert result.clip.qpos[0, 2] == pytest.approx(0.78, abs=0.02)


def test_a_rest_pose_that_stands_says_how_the_trunk_leans(tmp_path):
    """A straight spine with the names of LAFAN1 made a robot that leaned forward by 20.7 degrees."""
    mocap = renamed(tmp_path)
    assert find_map(mocap, "a.bvh").pelvis_pitch == 20.7  # in its rest pose all limbs are one bundle
    standing = mocap.positions[0].copy()
    found = find_map(replace(mocap, rest=standing), "a.bvh")
    assert (found.pelvis_pitch, found.torso_pitch) == (pytest.approx(20.7, abs=0.2), pytest.approx(0, abs=0.2))
    standing[mocap.names.index("Spine")] = standing[0] + [0, 7.4, 0]
    for turn in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        assert find_map(replace(mocap, rest=standing[:, turn]), "a.bvh").pelvis_pitch == 0
        assert propose_map(replace(mocap, rest=standing[:, turn]), "proposed").pelvis_pitch == 0


def test_a_trunk_without_length_does_not_fit(tmp_path):
    names = [*dict.fromkeys([*MAPS["cmu"].joints.values(), *MAPS["cmu_mb"].joints.values()])]
    mocap = bare(names)
    assert find_map(mocap, "a.bvh").name in ("cmu", "motionbuilder")
    mocap.positions[:, names.index("Neck")] = mocap.positions[:, names.index("Spine1")]
    assert find_map(mocap, "a.bvh").joints["neck"] == "Spine1"


def test_unknown_joints_are_listed():
    with pytest.raises(MotionError, match=r"a.bvh: its joints are those of none .*bandai.*lafan1.*joints are: Tail"):
        find_map(bare(["Tail"]), "a.bvh")


def test_keys():
    assert joint_keys(["a:Left_Hand", "RIGHT hand"]) == ["lefthand", "righthand"]
