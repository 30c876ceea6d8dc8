import mujoco
import numpy as np
import torch

from plat.motions.checks.feet import Soles, ground_level, lowest_step, stance
from plat.robots import G1
from tests.motions.formats.writers import bowing_clip


def test_points_are_the_lowest_of_the_contact_spheres():
    model = G1.model()
    data = mujoco.MjData(model)
    qpos = np.random.default_rng(0).normal(0, 0.3, (3, 36))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    points = Soles(G1).points(torch.from_numpy(qpos))
    for pose, found in zip(qpos, points, strict=True):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        for foot, side in enumerate(("left", "right")):
            geoms = [data.geom(f"{side}_foot{index}_collision").xpos for index in (1, 2, 3, 4)]
            np.testing.assert_allclose(found[foot], np.array(geoms) - [0, 0, 0.005], atol=1e-6)


def test_a_long_motion_is_worked_on_in_parts(monkeypatch):
    qpos = torch.from_numpy(bowing_clip().qpos)
    whole = Soles(G1).points(qpos)
    monkeypatch.setattr("plat.motions.checks.feet._CHUNK", 7)
    torch.testing.assert_close(Soles(G1).points(qpos), whole, rtol=0, atol=1e-12)


def hopping(height: float = 0.3, ground: float = 0.05) -> torch.Tensor:
    """Two feet of one point each at 50 Hz: one second of rest, a flight, one second of rest."""
    flight = 2 * np.sqrt(2 * height / 9.81)
    time = np.arange(0, flight, 0.02)
    z = np.concatenate((np.zeros(50), time * (flight - time) * 9.81 / 2, np.zeros(50))) + ground
    points = torch.zeros(len(z), 2, 1, 3, dtype=torch.float64)
    points[..., 2] = torch.from_numpy(z)[:, None, None]
    return points


def test_flight_is_no_stance_not_even_its_top():
    points = hopping()
    resting = stance(points, 50.0)
    assert resting[5:45].all()
    assert resting[-45:-5].all()
    assert not resting[(points[:, 0, 0, 2] > 0.06)].any()


def test_the_level_is_where_feet_rest():
    assert abs(ground_level(hopping(ground=0.05), 50.0) - 0.05) < 1e-6
    falling = torch.linspace(3, 1, 20, dtype=torch.float64)[:, None, None, None].expand(-1, 2, 1, 3)
    assert ground_level(falling, 50.0) == 1.0


def test_the_lowest_point_is_followed():
    points = torch.zeros(2, 2, 2, 3)
    points[0, ..., 2] = torch.tensor([[1.0, 2.0], [3.0, 0.5]])
    points[1, 1, 1] = torch.tensor([7.0, 8.0, 9.0])
    before, after = lowest_step(points)
    assert before.tolist() == [[0, 0, 0.5]]
    assert after.tolist() == [[7, 8, 9]]


def test_the_bow_stands_on_the_floor():
    clip = bowing_clip()
    points = Soles(G1).points(torch.from_numpy(clip.qpos))
    assert stance(points, clip.fps).all()
    assert abs(ground_level(points, clip.fps)) < 0.01
