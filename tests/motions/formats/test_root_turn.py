import csv
from pathlib import Path

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import generate_motions, load_motions, save_motions
from plat.motions.checks.feet import Soles
from plat.motions.formats.root_turn import likeliest_turn, refuse_other_turns, turn_cost
from plat.motions.formats.turns import euler_to_quat, turns_of_three
from plat.robots import G1
from plat.rotations_np import quat_multiply
from tests.conftest import standing_clip

from .writers import bowing_clip, turned

SOLES = Soles(G1)
CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def with_quat(clip, quat):
    return type(clip)(clip.name, np.concatenate((clip.qpos[:, :3], quat, clip.qpos[:, 7:]), 1), clip.fps)


@pytest.fixture(scope="module")
def walk():
    clips = generate_motions("train", seconds=20)
    return turned(next(clip for clip in clips if clip.name.startswith("walk_")), 0.2)


@pytest.mark.parametrize("heading", [0.0, 0.5, np.pi])
def test_a_motion_stands_as_it_was_written(heading):
    refuse_other_turns([bowing_clip(heading=heading)], SOLES)


@pytest.mark.parametrize(
    ("told", "change", "heading"),
    [
        ("the conjugate", lambda q: q * CONJUGATE, 0.1),
        ("zyxw", lambda q: q[:, ::-1], 0.1),
        ("wzyx", lambda q: q[:, [0, 3, 2, 1]], 0.1),
        ("xyzw where it was read as wxyz", lambda q: q[:, [1, 2, 3, 0]], 0.1),
        ("wxyz where it was read as xyzw", lambda q: q[:, [3, 0, 1, 2]], 3.0),
    ],
)
def test_a_bow_with_another_quaternion_is_refused_with_what_it_is(told, change, heading):
    bow = bowing_clip(heading=heading)
    with pytest.raises(MotionError, match=f"stand only if its root quaternion is {told}.*--quat-order"):
        refuse_other_turns([with_quat(bow, change(bow.qpos[:, 3:7]))], SOLES)


def test_the_conjugate_of_a_walk_is_refused_from_a_file_and_read_where_the_order_is_stated(tmp_path, walk):
    wrong = with_quat(walk, walk.qpos[:, 3:7] * CONJUGATE)
    np.savez(tmp_path / "walk.npz", walk=wrong.qpos, fps=wrong.fps)
    with pytest.raises(MotionError, match="from world to root"):
        load_motions(tmp_path / "walk.npz")
    (read,) = load_motions(tmp_path / "walk.npz", quat_order="wxyz")
    np.testing.assert_allclose(read.qpos, wrong.qpos, atol=1e-5)
    save_motions(tmp_path / "own.npz", [wrong])  # what plat wrote is as it says
    np.testing.assert_array_equal(load_motions(tmp_path / "own.npz")[0].qpos, read.qpos)


def test_one_odd_clip_does_not_refuse_a_file(walk):
    odd = with_quat(walk, walk.qpos[:, 3:7] * CONJUGATE)
    refuse_other_turns([walk, odd, walk], SOLES)
    with pytest.raises(MotionError):
        refuse_other_turns([odd, walk, odd], SOLES)


def test_who_lies_or_is_no_clip_raises_no_doubt():
    bow = bowing_clip()
    lying = with_quat(bow, quat_multiply(np.tile([np.sqrt(0.5), 0, np.sqrt(0.5), 0], (40, 1)), bow.qpos[:, 3:7]))
    refuse_other_turns([lying], SOLES)
    refuse_other_turns([], SOLES)


def test_a_leaning_robot_costs_more():
    bow = bowing_clip()
    tilt = np.tile([np.cos(0.1), np.sin(0.1), 0, 0], (40, 1))
    assert turn_cost(with_quat(bow, quat_multiply(tilt, bow.qpos[:, 3:7])).qpos, 50.0, SOLES) > turn_cost(
        bow.qpos, 50.0, SOLES
    )


def three_numbers(quat: np.ndarray, kind: str) -> np.ndarray:
    w, x, y, z = quat.astype(np.float64).T
    if kind == "rotation vectors":
        length = np.sqrt(x * x + y * y + z * z)
        return np.stack((x, y, z), 1) * (2 * np.arctan2(length, w) / np.maximum(length, 1e-12))[:, None]
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(2 * (w * y - z * x))
    return np.stack((roll, pitch, np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))), 1)


def write(path: Path, clip, angles: np.ndarray, names: tuple[str, str, str]) -> Path:
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["root_x", "root_y", "root_z", *names, *(f"{name}_joint" for name in G1.joint_names)])
        rows.writerows(np.concatenate((clip.qpos[:, :3], angles, clip.qpos[:, 7:]), 1).tolist())
    return path


@pytest.mark.parametrize("kind", ["rotation vectors", "Euler angles"])
def test_three_columns_are_what_makes_the_feet_stand(tmp_path, kind):
    bow = bowing_clip(heading=1.8)
    path = write(tmp_path / "bow_50fps.csv", bow, three_numbers(bow.qpos[:, 3:7], kind), ("rx", "ry", "rz"))
    (read,) = load_motions(path)
    same = np.abs((read.qpos[:, 3:7] * bow.qpos[:, 3:7]).sum(1))
    np.testing.assert_allclose(same, 1, atol=1e-5)


@pytest.mark.parametrize("names", [("rx", "ry", "rz"), ("root_roll", "root_pitch", "root_yaw")])
@pytest.mark.parametrize("unit", [1.0, 180 / np.pi])
def test_small_angles_are_in_the_unit_in_which_the_feet_stand(tmp_path, names, unit):
    """No value of them says that it is in degrees."""
    bow = bowing_clip(heading=0.08)
    start = type(bow)(bow.name, bow.qpos[:7], bow.fps)
    angles = unit * three_numbers(start.qpos[:, 3:7], "Euler angles")
    assert np.abs(angles).max() < 2 * np.pi
    (read,) = load_motions(write(tmp_path / "bow_50fps.csv", start, angles, names))
    np.testing.assert_allclose(np.abs((read.qpos[:, 3:7] * start.qpos[:, 3:7]).sum(1)), 1, atol=1e-4)


def test_named_angles_are_what_they_are_called(tmp_path):
    bow = bowing_clip(heading=1.8)
    angles = three_numbers(bow.qpos[:, 3:7], "Euler angles")
    (read,) = load_motions(write(tmp_path / "bow_50fps.csv", bow, angles, ("root_roll", "root_pitch", "root_yaw")))
    np.testing.assert_allclose(np.abs((read.qpos[:, 3:7] * bow.qpos[:, 3:7]).sum(1)), 1, atol=1e-5)


def test_what_the_feet_leave_open_is_said_and_what_is_the_same_is_not():
    bow = bowing_clip()
    heading = np.tile(G1.default_qpos, (40, 1))
    same = likeliest_turn({"a": bow.qpos, "b": bow.qpos.copy()}, 50.0, SOLES)
    assert same == ("a", True, ())
    other = heading.copy()
    other[:, 3:7] = [np.cos(0.3), 0, 0, np.sin(0.3)]
    assert likeliest_turn({"a": heading, "b": other}, 50.0, SOLES) == ("a", False, ("b",))


def test_turns_of_three_agree_for_one_axis():
    angles = np.zeros((5, 3))
    angles[:, 2] = np.linspace(-2, 2, 5)
    first, *others = turns_of_three(angles).values()
    for other in others:
        np.testing.assert_allclose(np.abs((first * other).sum(1)), 1, atol=1e-12)
    np.testing.assert_allclose(euler_to_quat(angles), euler_to_quat(angles, "zyx"), atol=1e-12)


@pytest.mark.parametrize("frames", [16, 61, 121, 181])
def test_a_body_that_slides_and_turns_is_read_as_it_is(frames):
    """No foot of it stands however it is read, and the difference between two readings is none."""
    refuse_other_turns([standing_clip(frames=frames)], SOLES)
