import numpy as np
import pytest

from plat.robots import G1

pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")

from plat.studio.checker import Checker
from plat.studio.policy_playback import PolicyPlayback
from plat.studio.poser import Poser
from plat.studio.templates import TEMPLATES, template
from plat.studio.timeline import Timeline

POSER, EMPTY = Poser(G1), Timeline.empty(G1)


@pytest.mark.parametrize("name", TEMPLATES)
def test_nothing_about_a_template_is_doubtful(name: str):
    timeline = template(name, EMPTY, POSER)
    assert timeline.selected == 1
    for label, verdict in zip(timeline.labels[1:], Checker(G1).timeline(timeline), strict=True):
        assert not verdict.words, label


def test_the_committed_policy_reaches_a_wave(policies):
    timeline = template("wave", EMPTY, POSER)
    scores = PolicyPlayback(G1, policies, lambda: timeline).compare(timeline)[0]["plat"]
    assert all(score.reached for score in scores)


def test_a_template_continues_where_the_selected_pose_is():
    there = G1.default_qpos.copy()
    there[:2] = 1.0, 2.0
    timeline = template("side step", EMPTY.inserted(there, 1.0), POSER)
    assert timeline.keyframes[-1].root_pos[:2].tolist() == pytest.approx([1.0, 2.2], abs=1e-6)


def test_a_template_is_made_of_the_selected_pose():
    there = G1.default_qpos.copy()
    there[3:7] = np.cos(0.5), 0.0, 0.0, np.sin(0.5)
    elbow = 7 + G1.joint_names.index("left_elbow")
    there[elbow] = 1.1
    bow = template("bow", EMPTY.inserted(there, 1.0), POSER)
    assert [frame.qpos[elbow] for frame in bow.keyframes] == pytest.approx([1.1] * 3, abs=0.05)
    back = bow.pose.root_pos[:2] - there[:2]
    np.testing.assert_allclose(back / np.linalg.norm(back), [-np.cos(1.0), -np.sin(1.0)], atol=0.1)
