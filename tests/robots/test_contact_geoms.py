"""Which geoms meet the floor, as MuJoCo has it."""

from dataclasses import replace
from itertools import product

import mujoco
import numpy as np
import pytest
import torch

from plat.envs import BatchedPhysics
from plat.motions.checks.underside import Underside
from plat.robots import G1
from plat.robots.contact_geoms import colliding_geoms, touches_floor, visual_groups


@pytest.mark.parametrize("floor", ["", 'contype="2" conaffinity="4"'])
def test_what_touches_the_floor_is_what_mujoco_lets_collide(floor):
    bits = list(product(range(8), repeat=2))
    bodies = "".join(
        f'<body pos="{place} 0 0.05"><freejoint/><geom size="0.1" contype="{kind}" conaffinity="{affinity}"/></body>'
        for place, (kind, affinity) in enumerate(bits)
    )
    plane = f'<geom name="floor" type="plane" size="0 0 1" {floor}/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{plane}{bodies}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    met = {int(geom) for contact in data.contact for geom in contact.geom} - {0}
    assert met == set(np.flatnonzero(touches_floor(model)).tolist())
    assert 0 < len(met) < len(bits)
    assert [bool(kind or affinity) for kind, affinity in bits] == colliding_geoms(model)[1:].tolist()


@pytest.fixture
def one_sided(tmp_path):
    """The G1 with feet that others do not see: they meet the floor and no other part of the robot."""
    spec = G1.spec()
    spec.delete(spec.geom("floor"))
    for foot in G1.feet:
        for geom in spec.body(foot).geoms:
            if geom.contype:
                geom.contype, geom.conaffinity = 0, 1
    spec.compile()
    (tmp_path / "robot.xml").write_text(spec.to_xml())
    return replace(G1, asset=str(tmp_path / "robot.xml"))


def test_feet_that_meet_the_floor_alone_are_soles(one_sided):
    model = one_sided.model()
    np.testing.assert_array_equal(one_sided.sole_geoms(model), G1.sole_geoms(G1.shared_model))
    qpos = G1.default_qpos[None]
    np.testing.assert_allclose(Underside(one_sided).heights(qpos), Underside(G1).heights(qpos), atol=1e-6)
    assert one_sided.model("capsules").ngeom == G1.model("capsules").ngeom


def test_their_friction_is_set(one_sided):
    physics = BatchedPhysics(one_sided.model(), 2)
    physics.set_friction(torch.tensor([1]), one_sided.feet, torch.tensor([0.3]))
    friction = physics.model_field("geom_friction")[:, one_sided.sole_geoms(one_sided.model()).ravel(), 0]
    torch.testing.assert_close(friction[1], torch.full((8,), 0.3, dtype=torch.float64))
    assert (friction[0] > 0.4).all()


@pytest.mark.parametrize(
    ("groups", "shown"),
    [((2, 3), (2,)), ((0, 2), (2,)), ((0, 1), (0, 1)), ((1, 3), (1,)), ((3, 4), (3, 4))],
)
def test_something_is_drawn_of_every_robot(groups, shown):
    geoms = "".join(f'<geom size="0.1" group="{group}"/>' for group in groups)
    floor = '<geom name="floor" type="plane" size="1 1 1" group="5"/>'
    text = f"<mujoco><worldbody>{floor}<body><freejoint/>{geoms}</body></worldbody></mujoco>"
    assert visual_groups(mujoco.MjModel.from_xml_string(text)) == shown
