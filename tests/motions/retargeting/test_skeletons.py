from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plat.errors import MotionError
from plat.motions.retargeting import SkeletonMap, builtin_maps, load_map, read_bvh
from plat.motions.retargeting.skeletons import Human, find_map, read_human

from .human import write_human

BANDAI, LAFAN1 = builtin_maps()


def human(path, skeleton: SkeletonMap) -> Human:
    return read_human(read_bvh(path), skeleton, "clip.bvh")


def test_the_map_is_found_by_the_joints_names(tmp_path):
    assert find_map(read_bvh(write_human(tmp_path / "a.bvh")).names, "a.bvh") == LAFAN1
    assert find_map([*BANDAI.joints.values(), "Tail"], "a.bvh") == BANDAI
    with pytest.raises(
        MotionError, match=r"a.bvh: its joints are those of none .*bandai, lafan1.*Its joints are: Tail"
    ):
        find_map(["Tail"], "a.bvh")


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("unit", [0.1, 1.0, 100.0], ids=["mm", "cm", "m"])
def test_units_and_up_axis_are_told_from_the_file(tmp_path, up, unit):
    auto = SkeletonMap("auto", LAFAN1.joints)
    expected = human(write_human(tmp_path / "a.bvh"), LAFAN1)
    found = human(write_human(tmp_path / "b.bvh", up=up, unit=unit), auto)
    assert found.leg == pytest.approx(0.859, abs=1e-3)
    for role, position in expected.positions.items():
        np.testing.assert_allclose(found.positions[role], position, atol=1e-4)
    np.testing.assert_allclose(found.rotations["left_ankle"], expected.rotations["left_ankle"], atol=1e-4)
    head = found.positions["neck"] - found.positions["hips"]
    left = found.positions["left_hip"] - found.positions["right_hip"]
    toes = found.positions["left_toe"] - found.positions["left_ankle"]
    assert head[0, 2] > 0.5
    # seen from above, left is a quarter turn against the clock from forward
    assert np.cross(left[0], toes[0])[2] < 0


def test_units_and_up_axis_that_cannot_be_told(tmp_path):
    auto = SkeletonMap("auto", LAFAN1.joints)
    with pytest.raises(MotionError, match=r"clip.bvh: legs of 8.6e-05 are human in neither"):
        human(write_human(tmp_path / "a.bvh", unit=1e6), auto)
    bvh = read_bvh(write_human(tmp_path / "b.bvh"))
    tilted = replace(
        bvh,
        positions=Rotation.from_euler("x", 40, degrees=True)
        .apply(bvh.positions.reshape(-1, 3))
        .reshape(bvh.positions.shape),
    )
    with pytest.raises(MotionError, match=r"clip.bvh: which axis is up"):
        read_human(tilted, auto, "clip.bvh")


def test_a_map_of_ones_own(tmp_path):
    joints = "\n".join(f"  {role}: my{name}" for role, name in LAFAN1.joints.items())
    (tmp_path / "mine.yaml").write_text(f"joints:\n{joints}\nunits: 0.0254\nup: z\npelvis_pitch: 20\n")
    skeleton = load_map(tmp_path / "mine.yaml")
    assert (skeleton.name, skeleton.units, skeleton.up, skeleton.pelvis_pitch) == ("mine", 0.0254, "z", 20)
    renamed = {name: f"my{name}" for name in LAFAN1.joints.values()}
    path = write_human(tmp_path / "a.bvh", unit=2.54, up="z", names=renamed)
    assert human(path, skeleton).leg == pytest.approx(0.859, abs=1e-3)
    with pytest.raises(MotionError, match=r"clip.bvh: lacks the joints \['Hips', "):
        human(path, LAFAN1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joints: [Hips]", r"'joints' lacks \['chest'"),
        ("joints: {tail: Tail}", r"has the unknown \['tail'\]"),
        ("units: cm", "expected the field 'joints'"),
        ("joints: {}\nscale: 2", "expected the field 'joints' and any of"),
        ("joints: {", "not a readable YAML file"),
        ("joints: {joints}\nunits: yard", "'units' is 'yard', expected auto, m, cm, mm"),
        ("joints: {joints}\nunits: -1", "'units' is -1"),
        ("joints: {joints}\nunits: [1]", r"'units' is \[1\]"),
        ("joints: {joints}\nup: w", "'up' is 'w', expected auto, x, y or z"),
        ("joints: {joints}\ntorso_pitch: much", "'torso_pitch' is 'much', expected degrees"),
    ],
)
def test_errors_of_a_map_name_file_and_field(tmp_path, text, message):
    (tmp_path / "mine.yaml").write_text(text.replace("{joints}", str(LAFAN1.joints)))
    with pytest.raises(MotionError, match=f"mine.*{message}"):
        load_map(tmp_path / "mine.yaml")


def test_missing_map():
    with pytest.raises(MotionError, match=r"'nowhere.yaml': not a readable"):
        load_map("nowhere.yaml")
