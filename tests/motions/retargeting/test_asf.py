"""A skeleton of our own as ASF and AMC, in poses whose joints are worked out another way."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plat.errors import MotionError
from plat.motions import load_motions
from plat.motions.retargeting import read_amc, retarget
from plat.motions.retargeting.asf import find_asf

INCHES = 0.45 / 2.54  # units a centimeter
# name, parent, direction, length in cm, axis in degrees, dof
BONES = [
    *(
        row
        for side, sign in (("l", 1), ("r", -1))
        for row in (
            (f"{side}hipjoint", "root", (0.75 * sign, -0.6, 0.28), 13, (0, 0, 0), ""),
            (f"{side}femur", f"{side}hipjoint", (0.34 * sign, -0.94, 0), 42, (0, 0, 20 * sign), "rx ry rz"),
            (f"{side}tibia", f"{side}femur", (0.34 * sign, -0.94, 0), 42, (0, 0, 20 * sign), "rx"),
            (f"{side}foot", f"{side}tibia", (0.1 * sign, -0.25, 0.96), 13, (-90, 0, 20 * sign), "rx rz"),
            (f"{side}toes", f"{side}foot", (0, 0, 1), 6, (-90, 0, 20 * sign), "rx"),
        )
    ),
    ("lowerback", "root", (0, 1, -0.03), 12, (0, 0, 0), "rx ry rz"),
    ("upperback", "lowerback", (0, 1, 0), 12, (0, 0, 0), "rx ry rz"),
    ("thorax", "upperback", (0, 1, 0.01), 12, (0, 0, 0), "rx ry rz"),
    ("lowerneck", "thorax", (0, 1, 0.1), 10, (0, 0, 0), "rx ry rz"),
    *(
        row
        for side, sign in (("l", 1), ("r", -1))
        for row in (
            (f"{side}clavicle", "thorax", (0.93 * sign, 0.36, 0), 20, (0, 0, 0), "ry rz"),
            (f"{side}humerus", f"{side}clavicle", (sign, 0, 0), 29, (180, 30 * sign, 90 * sign), "rx ry rz"),
            (f"{side}radius", f"{side}humerus", (sign, 0, 0), 24, (180, 30 * sign, 90 * sign), "rx"),
        )
    ),
]
# angles of the pose that the person takes and leaves, in degrees
POSE = {"lfemur": (-30, 5, 8), "ltibia": (40,), "lfoot": (-8, 2), "thorax": (5, 10, -3), "lhumerus": (-30, 10, 60)}
POSE |= {"rhumerus": (10, -20, -70), "rradius": (35,), "lradius": (20,)}


def unit(direction) -> np.ndarray:
    return np.array(direction) / np.linalg.norm(direction)


def write_asf(path: Path, radians: bool = False, drop: tuple[str, ...] = ()) -> None:
    angle = np.pi / 180 if radians else 1.0
    lines = [
        ":version 1.10",
        ":units",
        "  mass 1.0",
        "  length 0.45",
        f"  angle {'rad' if radians else 'deg'}",
        ":root",
    ]
    lines += ["   order TX TY TZ RX RY RZ", "   axis XYZ", "   position 0 0 0", "   orientation 0 0 0", ":bonedata"]
    for name, _, direction, length, axis, dof in BONES:
        if name not in drop:
            lines += ["  begin", f"     name {name}", f"     direction {' '.join(map(str, unit(direction)))}"]
            lines += [f"     length {length * INCHES}", f"     axis {' '.join(str(a * angle) for a in axis)} XYZ"]
            lines += [*([f"    dof {dof}", "    limits (-160 20)", "           (-70 70)"] if dof else []), "  end"]
    children = {parent: [b[0] for b in BONES if b[1] == parent and b[0] not in drop] for _, parent, *_ in BONES}
    lines += [":hierarchy", "  begin", *(f"    {p} {' '.join(c)}" for p, c in children.items() if c and p not in drop)]
    path.write_text("\n".join([*lines, "  end", ""]))


def angles_at(share: float) -> dict[str, np.ndarray]:
    return {n: share * np.array(POSE.get(n, (0,) * len(dof.split())), float) for n, *_, dof in BONES if dof}


def write_amc(
    path: Path,
    frames: int = 20,
    radians: bool = False,
    drop: tuple[str, ...] = (),
    told: str = "",
    size: float = 1.0,
    planted: bool = False,
) -> None:
    angle = np.pi / 180 if radians else 1.0
    lines = ["#!OML:ASF a.ASF", ":FULLY-SPECIFIED", told or (":RADIANS" if radians else ":DEGREES")]
    rng = np.random.default_rng(0)
    for frame in range(frames):
        share = size * np.sin(np.pi * frame / (frames - 1)) ** 2
        x, y, z = np.array([3, 91, 0 if planted else frame]) - (places_of_pose(share)["ltoes"] if planted else 0)
        rows = [f"root {x * INCHES} {y * INCHES} {z * INCHES} 0 {0 if planted else 0.5 * angle * frame} 0"]
        for name, values in angles_at(share).items():
            if name not in drop:
                rows.append(f"{name} {' '.join(f'{angle * value:.8g}' for value in values)}")
        rng.shuffle(rows)
        lines += [str(frame + 1), *rows]
    path.write_text("\n".join([*lines, ""]))


def places_of_pose(share: float = 1.0) -> dict[str, np.ndarray]:
    """Ends of the bones from the root in a share of the pose (cm). Bones turn by C R C', R and C about fixed axes."""
    ends, turns = {"root": np.zeros(3)}, {"root": Rotation.identity()}
    for name, parent, direction, length, axis, dof in BONES:
        own = Rotation.from_euler("xyz", axis, degrees=True)
        turn = Rotation.identity()
        for what, value in zip(dof.split(), angles_at(share).get(name, ()), strict=True):
            turn = Rotation.from_euler(what[1], value, degrees=True) * turn
        turns[name] = turns[parent] * own * turn * own.inv()
        ends[name] = ends[parent] + turns[name].apply(length * unit(direction))
    return ends


def test_joints_are_where_the_angles_put_them(tmp_path):
    write_asf(tmp_path / "a.asf")
    write_amc(tmp_path / "a.amc", frames=3)
    mocap = read_amc(tmp_path / "a.amc", fps=60)
    spin = Rotation.from_euler("y", 0.5, degrees=True)
    for name, place in places_of_pose().items():
        if name != "root":
            found = mocap.positions[1, mocap.names.index(f"{name}_end")] / INCHES
            np.testing.assert_allclose(found, spin.apply(place) + np.array([3, 91, 1]), atol=1e-4)
    assert (mocap.fps, mocap.notes) == (60, ())
    knee = mocap.names.index("ltibia")
    np.testing.assert_allclose(mocap.positions[:, knee], mocap.positions[:, mocap.names.index("lfemur_end")])


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le"])
def test_text_as_windows_writes_it(tmp_path, encoding):
    write_asf(tmp_path / "a.asf")
    write_amc(tmp_path / "a.amc", frames=3)
    expected = read_amc(tmp_path / "a.amc")
    for path in tmp_path.iterdir():
        path.write_text(path.read_text(), encoding=encoding)
    np.testing.assert_array_equal(read_amc(tmp_path / "a.amc").positions, expected.positions)


@pytest.mark.parametrize("radians", [False, True])
def test_angles_in_both_units_whatever_is_stated(tmp_path, radians):
    write_asf(tmp_path / "a.asf", radians)
    write_amc(tmp_path / "a.amc", radians=radians, planted=True)
    expected = read_amc(tmp_path / "a.amc")
    write_amc(tmp_path / "a.amc", radians=radians, told=":DEGREES" if radians else ":RADIANS", planted=True)
    found = read_amc(tmp_path / "a.amc")
    np.testing.assert_allclose(found.positions, expected.positions)
    assert f"angles in {'radians' if radians else 'degrees'} and not as stated, as the motion shows" in found.notes


@pytest.mark.parametrize(("size", "most"), [(0.09, 0.4), (0.015, 0.1)])
def test_someone_who_stands_quietly_is_in_degrees_as_stated(tmp_path, size, most):
    write_asf(tmp_path / "a.asf")
    write_amc(tmp_path / "a.amc", frames=12, size=size)
    mocap = read_amc(tmp_path / "a.amc", fps=60)
    assert mocap.notes == ()
    assert np.abs(mocap.rotations - np.eye(3)).max() < most


def test_small_motion_is_in_radians_where_that_is_stated(tmp_path):
    write_asf(tmp_path / "a.asf")
    write_amc(tmp_path / "a.amc", frames=12, size=0.015)
    radians = read_amc(tmp_path / "a.amc", fps=60, angles="radians")
    assert np.abs(radians.rotations - np.eye(3)).max() > 0.5


def test_bones_may_be_missing(tmp_path):
    write_asf(tmp_path / "a.asf", drop=("ltoes", "rtoes"))
    write_amc(tmp_path / "a.amc", drop=("ltoes", "rtoes", "lowerneck"))
    mocap = read_amc(tmp_path / "a.amc")
    assert "ltoes" not in mocap.names
    assert "no values for lowerneck: rest pose" in mocap.notes


@pytest.mark.parametrize(
    ("name", "rate"),
    [
        ("a.amc", 120),
        ("a_60fps.amc", 60),
        ("HDM_bd_walk_001_30.amc", 30),
        ("a_14.amc", 120),
        ("16_30.amc", 120),
        ("cmu_14_60.amc", 120),
        ("walk_30.amc", 120),
        ("HDM_bd_01-01_03_60.amc", 60),
        ("HDM_bd_walk_007_14.amc", 120),
    ],
)
def test_the_rate_is_in_the_name_or_the_usual_one(tmp_path, name, rate):
    write_asf(tmp_path / "a.asf")
    write_amc(tmp_path / name, frames=3)
    assert read_amc(tmp_path / name).fps == rate


def renumbered(path: Path, numbers: list[int]) -> None:
    """Write other numbers over those of the frames, and leave out frames beyond them."""
    given, kept = iter(numbers), []
    for line in path.read_text().splitlines():
        if line.isdecimal() and (line := str(next(given, ""))) == "":
            break
        kept.append(line)
    path.write_text("\n".join([*kept, ""]))


def test_numbers_in_steps_are_of_a_slower_take(tmp_path):
    write_asf(tmp_path / "a.asf")
    for name in ("a.amc", "a_60fps.amc"):
        write_amc(tmp_path / name, frames=4)
        renumbered(tmp_path / name, [1, 5, 9, 13])
    mocap = read_amc(tmp_path / "a.amc")
    assert (mocap.fps, len(mocap.positions)) == (30, 4)
    assert any("numbered in steps of 4" in note for note in mocap.notes)
    assert read_amc(tmp_path / "a.amc", fps=120).fps == 120
    assert read_amc(tmp_path / "a_60fps.amc").fps == 60


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ([1, 2, 7, 8], "frame 2 is followed by 7: frames are missing"),
        ([1, 2, 1, 2], r"frame 2 is followed by 1: are these several motions\?"),
        ([1, 2, 2, 3], "frame 2 is followed by 2: a frame is there twice"),
    ],
)
def test_frames_that_are_not_in_order_are_refused(tmp_path, numbers, message):
    write_asf(tmp_path / "a.asf")
    write_amc(tmp_path / "a.amc", frames=4)
    renumbered(tmp_path / "a.amc", numbers)
    with pytest.raises(MotionError, match=message):
        read_amc(tmp_path / "a.amc")


def test_a_last_frame_that_is_cut_off_is_left_out(tmp_path):
    write_asf(tmp_path / "a.asf")
    write_amc(tmp_path / "a.amc", frames=4)
    whole = read_amc(tmp_path / "a.amc")
    lines = (tmp_path / "a.amc").read_text().splitlines()
    (tmp_path / "a.amc").write_text("\n".join(lines[:-3]))
    mocap = read_amc(tmp_path / "a.amc")
    np.testing.assert_array_equal(mocap.positions, whole.positions[:3])
    assert any("the last frame left out" in note for note in mocap.notes)
    assert not any("rest pose" in note for note in mocap.notes)


def test_a_frame_that_lacks_a_bone_is_refused(tmp_path):
    write_asf(tmp_path / "a.asf")
    write_amc(tmp_path / "a.amc", frames=4)
    lines = (tmp_path / "a.amc").read_text().splitlines()
    lost = lines.index("2") + 1
    name = lines.pop(lost).split()[0]
    (tmp_path / "a.amc").write_text("\n".join([*lines, ""]))
    with pytest.raises(MotionError, match=f"the 2. frame lacks '{name}'"):
        read_amc(tmp_path / "a.amc")


def test_the_skeleton_lies_beside_it(tmp_path):
    with pytest.raises(MotionError, match="expected its skeleton .* found none"):
        find_asf(tmp_path / "cmu_14_37.amc")
    for name in ("cmu_14.asf", "cmu_1.ASF", "other.asf"):
        write_asf(tmp_path / name)
    assert find_asf(tmp_path / "cmu_14_37.amc").name == "cmu_14.asf"
    assert find_asf(tmp_path / "cmu_1-2.amc").name == "cmu_1.ASF"
    with pytest.raises(MotionError, match="found 3 of them"):
        find_asf(tmp_path / "cmu_144_37.amc")  # of another subject than 14 and 1
    with pytest.raises(MotionError, match=r"found 3 of them .cmu_1.ASF, cmu_14.asf, other.asf"):
        find_asf(tmp_path / "15_01.amc")


def test_a_skeleton_that_is_called_otherwise_is_told(tmp_path):
    write_asf(tmp_path / "14.asf")
    for name in ("14_37", "144_37"):
        write_amc(tmp_path / f"{name}.amc", frames=3)
    told = "skeleton 14.asf, the only one beside it"
    assert told in read_amc(tmp_path / "144_37.amc").notes
    assert told not in read_amc(tmp_path / "14_37.amc").notes


def test_it_becomes_a_motion_of_the_robot(tmp_path):
    pytest.importorskip("mink")
    write_asf(tmp_path / "a.asf")
    write_amc(tmp_path / "a_60fps.amc", frames=90)
    result = retarget(tmp_path / "a_60fps.amc")
    assert result.error < 0.02
    assert result.clip.notes[:2] == ("map asf", "fps from the file name")
    (clip,) = load_motions(tmp_path / "a_60fps.amc")
    assert (clip.fps, len(clip.qpos)) == (60, 90)
    np.testing.assert_array_equal(clip.qpos, result.clip.qpos)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("a.amc", "\nltibia ", "\nltail ", "AMC file .*line .*'ltail .*expected a bone of the skeleton"),
        ("a.amc", "\nltibia 0", "\nltibia x", "AMC file .*line .*expected 1 number$"),
        ("a.amc", "\nltibia 0", "\nltibia 0 0", "AMC file .*line .*expected 1 number$"),
        ("a.amc", "\n1\n", "\n", "AMC file .*expected a frame's number"),
        ("a.asf", "length 7", "length x", "ASF file .*line .* is not understood"),
        ("a.asf", "length 7.44", "length inf ", "ASF file .*line .*'length inf .* is not understood"),
        ("a.asf", "direction 0.34", "direction\n  0.", "ASF file .*line .*'direction' is not understood"),
        ("a.asf", "direction 0.34", "direction nan ", "ASF file .*line .*'direction nan .* is not understood"),
        ("a.asf", "axis 0.0 0.0 0.0 ", "axis 0.0 0.0 ", "ASF file .*line .*'axis .* is not understood"),
        ("a.asf", "dof rx", "dof r", "ASF file .*line .*'dof r.* is not understood"),
        ("a.asf", "order TX", "order TQ", "ASF file .*line .*'order TQ.* is not understood"),
        ("a.asf", "ltibia lfoot", "ltail lfoot", "ASF file .*of all bones; lost: .'lfoot'"),
        ("a.asf", ":bonedata", ":bones", "ASF file"),
    ],
)
def test_errors_name_file_and_line(tmp_path, file, old, new, message):
    write_asf(tmp_path / "a.asf")
    write_amc(tmp_path / "a.amc", frames=2)
    text = (tmp_path / file).read_text()
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new, 1))
    with pytest.raises(MotionError, match=message):
        read_amc(tmp_path / "a.amc")


def test_an_empty_motion_is_refused(tmp_path):
    write_asf(tmp_path / "a.asf")
    (tmp_path / "a.amc").write_text(":DEGREES\n")
    with pytest.raises(MotionError, match="no frames"):
        read_amc(tmp_path / "a.amc")


def test_what_a_root_has_beside_its_order_is_said(tmp_path):
    write_asf(tmp_path / "one.asf")
    write_amc(tmp_path / "one.amc", frames=4)
    plain = read_amc(tmp_path / "one.amc")
    text = (tmp_path / "one.asf").read_text()
    for old, new, told in (
        ("orientation 0 0 0", "orientation 0 90 0", "the root's 'orientation' in the skeleton left out"),
        ("axis XYZ\n   position", "axis ZYX\n   position", "the root turns about XYZ, as its 'order' lists them"),
    ):
        (tmp_path / "one.asf").write_text(text.replace(old, new))
        found = read_amc(tmp_path / "one.amc")
        assert any(note.startswith(told) for note in found.notes)
        assert not any(note.startswith(told) for note in plain.notes)
        np.testing.assert_array_equal(found.positions, plain.positions)
