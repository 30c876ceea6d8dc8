import os
import sys

import pytest

from plat.control import Chase, Simulator, Viewer
from plat.keyframes import KeyframeSequence, standing
from plat.rendering import RenderingError, stage_model
from plat.robots import G1
from tests.control.puppets import Puppet

HEADLESS = sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ)


@pytest.mark.skipif(not HEADLESS, reason="this machine has a display")
def test_without_a_display_one_line_says_so():
    with pytest.raises(RenderingError, match=r"no window for the viewer \(.*DISPLAY.*record a video"):
        Viewer(Simulator(G1.model()))


@pytest.mark.skipif(HEADLESS, reason="this machine has no display")
def test_a_chase_is_shown_in_real_time():
    simulator = Simulator(stage_model(G1))
    chase = Chase(Puppet(), KeyframeSequence(G1, standing(G1), (standing(G1).at(0.2),)), simulator, hold=0.1)
    viewer = Viewer(simulator)
    for step in chase:
        assert viewer.running
        viewer.show(step)
    viewer.close()
    assert not viewer.running


def test_the_model_that_is_good_to_look_at_moves_as_the_plain_one_does():
    ends = []
    for model in (G1.model(), stage_model(G1)):
        sequence = KeyframeSequence(G1, standing(G1), (standing(G1).at(0.4),))
        ends.append([step.after.joint_pos for step in Chase(Puppet(), sequence, Simulator(model))])
    assert (ends[0][-1] == ends[1][-1]).all()
