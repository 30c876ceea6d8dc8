"""What is sent to browsers to draw the scene."""

from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from plat.robots import G1

pytest.importorskip("viser", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("mjviser", reason="the extra plat-rl[studio] is not installed")

from plat.studio.checker import Checker
from plat.studio.scene import Bodies, Figure, RobotView, StanceView


class Node:
    """A node that remembers what was set."""

    def __init__(self, *data, **fields):
        self.__dict__.update({"visible": True, "color": None, **fields}, data=data, changes=[])

    def __setattr__(self, name, value):
        self.__dict__[name] = value
        self.changes.append(name)


@pytest.fixture
def server():
    nodes = {}

    def add(name, *data, **fields):
        nodes[name] = Node(*data, **fields)
        return nodes[name]

    @contextmanager
    def atomic():
        yield

    kinds = ("add_frame", "add_mesh_trimesh", "add_mesh_simple", "add_line_segments", "add_icosphere")
    return SimpleNamespace(scene=SimpleNamespace(**dict.fromkeys(kinds, add)), atomic=atomic, nodes=nodes)


def test_only_what_has_moved_is_sent(server):
    view, bodies = RobotView(server, Bodies(G1), "robot"), Bodies(G1)
    qpos = G1.default_qpos.copy()
    view.show(qpos)
    for node in server.nodes.values():
        node.changes.clear()
    view.show(qpos)
    assert not any(node.changes for node in server.nodes.values())
    qpos[7 + G1.joint_names.index("right_wrist_yaw")] += 0.3
    view.show(qpos)
    assert {name for name, node in server.nodes.items() if node.changes} == {"robot/right_wrist_yaw_link"}
    assert server.nodes["robot/right_wrist_yaw_link"].changes == ["wxyz"], "it turned about its own origin"
    quat = bodies.placed(qpos)[1]
    here = bodies.names.index("right_wrist_yaw_link")
    np.testing.assert_allclose(server.nodes["robot/right_wrist_yaw_link"].wxyz, quat[here])


def test_small_steps_add_up(server):
    view, bodies = RobotView(server, Bodies(G1), "robot"), Bodies(G1)
    qpos = G1.default_qpos.copy()
    for _ in range(50):
        view.show(qpos)
        qpos[2] += 2e-6
    node = server.nodes["robot/pelvis"]
    assert abs(node.position[2] - bodies.placed(qpos)[0][bodies.names.index("pelvis")][2]) < 2e-5


def test_a_figure_leaves_out_what_another_one_covers(server):
    figure = Figure(server, Bodies(G1), "figure", (0, 0, 255), 0.2)
    qpos = G1.default_qpos.copy()
    figure.show(qpos)
    assert all(node.visible for node in server.nodes.values())
    other = qpos.copy()
    other[7 + G1.joint_names.index("right_elbow")] += 0.5
    figure.show(qpos, beside=other)
    seen = {name.removeprefix("figure/") for name, node in server.nodes.items() if node.visible}
    wrist = {f"right_wrist_{axis}_link" for axis in ("roll", "pitch", "yaw")}
    assert seen == {"figure", "right_elbow_link", *wrist}
    figure.show(qpos, beside=other + 0.1)
    assert all(node.visible for node in server.nodes.values())


def test_the_support_polygon_goes_along_and_follows_its_corners(server):
    view, checker = StanceView(server, "stance"), Checker(G1)
    here = G1.default_qpos
    view.show(checker.stance(here))
    first, edges = server.nodes["stance/support"].position, server.nodes["stance/support/edges"]
    assert len(edges.data[0]) == len(checker.stance(here).support)
    view.show(checker.stance(here + 3 * np.eye(len(here))[0]))
    np.testing.assert_allclose(server.nodes["stance/support"].position - first, [3, 0, 0], atol=1e-9)
    assert server.nodes["stance/support/edges"] is edges, "the same shape is not sent again"
    lifted = here.copy()
    lifted[7 + G1.joint_names.index("left_knee")] += 0.6
    view.show(checker.stance(lifted))
    assert server.nodes["stance/support/edges"] is not edges, "it stands on the other foot"
    view.show(checker.stance(here + 0.3 * np.eye(len(here))[2]))
    assert server.nodes["stance/support"].visible is False, "in the air there is none"
    assert server.nodes["stance/center/spot"].color == (214, 54, 59)
    view.show(None)
    assert server.nodes["stance"].visible is False


def test_meshes_are_light_and_keep_their_size():
    bodies, exact = Bodies(G1), Bodies(G1, 1e-7, 1e-7)
    triangles = [sum(len(mesh.faces) for mesh in some.meshes) for some in (bodies, exact)]
    assert triangles[0] < triangles[1] / 8
    for name, mesh, (vertices, faces), true in zip(
        bodies.names, bodies.meshes, bodies.coarse_meshes, exact.meshes, strict=True
    ):
        assert 0 < len(faces) <= len(mesh.faces), name
        assert faces.max() < len(vertices)
        np.testing.assert_allclose(mesh.extents, true.extents, atol=0.006, err_msg=name)
        np.testing.assert_allclose(np.ptp(vertices, axis=0), true.extents, atol=0.012, err_msg=name)


def test_a_robot_with_visual_geoms_in_another_group_is_there(tmp_path):
    """As in Unitree's own file, which has them in group 1."""
    text = G1.asset_path.read_text()
    assert 'group="2"' in text
    (tmp_path / "robot.xml").write_text(text.replace('group="2"', 'group="1"'))
    assert Bodies(replace(G1, asset=str(tmp_path / "robot.xml"))).names == Bodies(G1).names != []
