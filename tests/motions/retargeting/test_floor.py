import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plat.motions import validate_motion
from plat.motions.checks.underside import Underside
from plat.motions.retargeting import SolverOptions, read_bvh, retarget
from plat.motions.retargeting.floor import above_floor
from plat.motions.retargeting.targets import Targets
from plat.robots import G1

from .human import write_human


def test_targets_are_raised_to_where_a_body_lies_on_the_floor():
    places = np.array([[0.0, 1.0, -0.05], [0.0, 1.0, 0.4]])
    targets = Targets({"left_wrist": places, "left_ankle": places.copy()})
    raised = above_floor(targets, G1)
    assert raised == {"left_wrist": pytest.approx(0.083)}
    np.testing.assert_allclose(targets.positions["left_wrist"][:, 2], [0.033, 0.4])
    np.testing.assert_array_equal(targets.positions["left_ankle"], places)


def test_who_lies_on_the_back_stays_on_the_floor(tmp_path):
    path = write_human(tmp_path / "lying.bvh", frames=20)
    lines = path.read_text().splitlines()
    first = lines.index("Frame Time: 0.033333") + 1
    for number, line in enumerate(lines[first:], first):
        values = line.split()
        turned = Rotation.from_euler("x", -90, degrees=True) * Rotation.from_euler(
            "ZYX", np.array(values[3:6], float), degrees=True
        )
        values[:3], values[3:6] = ["0", "12", "0"], [f"{angle:.5f}" for angle in turned.as_euler("ZYX", degrees=True)]
        lines[number] = " ".join(values)
    path.write_text("\n".join(lines) + "\n")
    assert read_bvh(path).positions[0, :, 1].max() < 60
    result = retarget(path, up="y")
    heights = Underside(G1).heights(result.clip.qpos)
    assert heights.min() > -1e-4
    assert heights.min(1).max() < 0.03
    assert result.error < 0.06
    assert abs(validate_motion(result.clip).floating) < 0.03


def test_words_for_what_could_not_be_done(tmp_path):
    path = write_human(tmp_path / "wave.bvh", turns={"RightArm": (0, 70, 0)}, frames=20)
    result = retarget(path, options=SolverOptions(max_joint_speed=0.5))
    assert any("cm off its target at" in told for told in result.shortfalls)
    assert any("at its speed limit for" in told for told in result.shortfalls)
    assert set(result.shortfalls) <= set(result.clip.notes)
    calm = retarget(write_human(tmp_path / "calm.bvh", frames=5))
    assert calm.shortfalls == ()


def test_a_human_whose_feet_never_stand_is_told(tmp_path):
    """On a treadmill, or at another frame rate, a slip of 0.00 cm/s read as perfect."""
    path = write_human(tmp_path / "glide.bvh", frames=12)
    head, rows = path.read_text().split("Frame Time: 0.033333\n")
    places = [row.split(" ", 1) for row in rows.splitlines()]
    glided = [f"{float(first) + 5 * frame} {rest}" for frame, (first, rest) in enumerate(places)]
    path.write_text(head + "Frame Time: 0.033333\n" + "\n".join(glided))
    result = retarget(path)
    assert result.slip == 0
    assert "no foot ever stands still on the floor" in result.shortfalls
