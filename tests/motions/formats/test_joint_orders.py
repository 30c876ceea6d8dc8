import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import load_motions
from plat.motions.formats.joint_orders import breadth_first, likely_order, usual_orders
from plat.robots import G1
from tests.motions.formats.test_layouts import clip_with_arms
from tests.motions.formats.writers import ISAAC_ORDER

OWN = list(G1.joint_names)
ANGLES = clip_with_arms(0.7).qpos[:, 7:].astype(float)
OTHER = {"left": "right", "right": "left"}


def listed(angles: np.ndarray, names: list[str]) -> np.ndarray:
    return angles[:, [OWN.index(name) for name in names]]


def exchanged(names: list[str]) -> list[str]:
    return ["_".join((OTHER.get(side, side), *rest)) for side, *rest in (name.split("_", 1) for name in names)]


def test_breadth_first_is_the_order_of_isaac_lab():
    assert breadth_first(G1) == ISAAC_ORDER


def test_orders_hold_every_joint_once():
    orders = usual_orders(G1)
    assert len(orders) == 10
    assert len({tuple(order) for order in orders.values()} | {tuple(OWN)}) == 11
    for order in orders.values():
        assert sorted(order) == sorted(OWN)


def test_orders_of_a_robot_without_a_waist_differ_from_each_other():
    """Equal ones would both lead to recorded bodies, and which it is would not be told."""
    names = ("left_hip", "left_knee", "right_hip", "right_knee", "left_elbow", "right_elbow")
    orders = [tuple(order) for order in usual_orders(SimpleNamespace(joint_names=names, depth=len)).values()]
    assert len({names, *orders}) == 1 + len(orders) > 2


def test_the_robot_s_own_order_needs_no_word():
    assert likely_order(ANGLES, G1) == (OWN, [])


def test_poses_say_nothing_of_a_robot_whose_joints_turn_the_other_way(tmp_path):
    """A knee with negative angles: its bows were as likely with the waist first."""
    text = G1.asset_path.read_text()
    for side in ("left", "right"):
        knee = f'<joint name="{side}_knee_joint" class="m7520_22" axis="0 1 0" range="-0.087267 2.8798"/>'
        assert knee in text
        text = text.replace(knee, knee.replace("0 1 0", "0 -1 0").replace("-0.087267 2.8798", "-2.8798 0.087267"))
    (tmp_path / "robot.xml").write_text(text)
    pose = {name: -angle if "knee" in name else angle for name, angle in G1.default_pose.items()}
    assert likely_order(ANGLES, replace(G1, asset=str(tmp_path / "robot.xml"), default_pose=pose)) is None


@pytest.mark.parametrize("label", usual_orders(G1))
def test_other_orders_are_seen_in_the_poses(label):
    order = usual_orders(G1)[label]
    assert likely_order(listed(ANGLES, order), G1) == (
        order,
        [f"joints numbered {label}: only so are its poses likely"],
    )
    if label == "with the wrists last":  # the right side first, this pose leaves it open
        with pytest.raises(MotionError, match=f"with them {label}; name them"):
            likely_order(listed(ANGLES, exchanged(order)), G1)
        return
    found, _ = likely_order(listed(ANGLES, exchanged(order)), G1)
    assert found in (order, exchanged(order))


def test_between_two_orders_it_is_not_to_be_told():
    between = 0.2 * ANGLES + 0.8 * listed(ANGLES, usual_orders(G1)["with the waist last"])
    with pytest.raises(MotionError, match="its poses are as likely .*; name them, in a header or 'joint_names'"):
        likely_order(between, G1)


def test_a_robot_at_zero_has_the_same_pose_in_every_order():
    assert likely_order(np.zeros((3, 29)), G1) == (OWN, [])


WRISTS_LAST = [name for name in OWN if "wrist" not in name] + [name for name in OWN if "wrist" in name]


@pytest.mark.parametrize(
    ("label", "order"),
    [
        ("in alphabetical order", sorted(OWN)),
        ("with the wrists last", WRISTS_LAST),
        ("with waist, then arms, then legs", OWN[12:] + OWN[:12]),
        ("with arms, then legs, then waist", OWN[15:] + OWN[:15]),
    ],
)
def test_a_file_in_another_order_is_read_right(tmp_path, label, order):
    clip = clip_with_arms(0.7)
    numbered = np.concatenate((clip.qpos[:, :7], listed(clip.qpos[:, 7:], order)), 1)
    np.savez(tmp_path / "walk.npz", qpos=numbered, fps=50)
    (found,) = load_motions(tmp_path / "walk.npz")
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-6)
    assert f"joints numbered {label}: only so are its poses likely" in found.notes


def test_broken_angles_have_no_order():
    assert likely_order(np.full((3, 29), np.nan), G1) is None


@pytest.mark.parametrize("joint", ["right_shoulder_roll", "left_hip_roll", "left_knee"])
@pytest.mark.parametrize("ending", ["npz", "npy", "pkl"])
def test_a_broken_angle_is_told_and_no_side_blamed(tmp_path, joint, ending):
    rows = clip_with_arms(0.7).qpos.astype(float)
    column = 7 + OWN.index(joint)
    rows[5, column] = np.nan
    path = tmp_path / f"walk_50fps.{ending}"
    if ending == "npz":
        np.savez(path, qpos=rows, fps=50)
    elif ending == "npy":
        np.save(path, rows)
    else:
        path.write_bytes(pickle.dumps({"qpos": rows, "fps": 50}))
    with pytest.raises(MotionError, match=rf"qpos\[5, {column}\] is nan, expected a finite number"):
        load_motions(path)


def test_real_motions_keep_their_order(shared_data):
    for clip in load_motions(shared_data / "motions" / "bandai_val.npz")[::4]:
        assert likely_order(clip.qpos[:, 7:].astype(float), G1) == (OWN, []), clip.name
