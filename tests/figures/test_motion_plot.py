"""The plot of a clip over time."""

from dataclasses import replace

import numpy as np
import pytest

from plat.figures import motion_plot
from plat.motions import ValidationLimits, validate_motion
from plat.robots import G1
from tests.motions.formats.writers import bowing_clip

pytest.importorskip("matplotlib")


def curves(panel) -> list[np.ndarray]:
    return [np.asarray(line.get_ydata(), dtype=float) for line in panel.lines]


def test_joints_are_shown_within_their_limits_and_the_nearest_are_named():
    clip = bowing_clip(60)
    low, high = G1.joint_range.numpy()[3]
    clip.qpos[:, 7 + 3] = low + 0.98 * (high - low)
    joints = motion_plot(clip, validate_motion(clip)).axes[0]
    np.testing.assert_allclose(curves(joints)[3], 0.98, atol=1e-6)
    assert G1.joint_names[3].replace("_", " ") in {text.get_text() for text in joints.get_legend().get_texts()}


def test_soles_and_speeds_have_their_units():
    clip = bowing_clip(60)
    raised = replace(clip, qpos=clip.qpos + np.eye(clip.qpos.shape[1])[2] * 0.1)
    low, high = (motion_plot(one, validate_motion(one)).axes[1] for one in (clip, raised))
    np.testing.assert_allclose(curves(high)[0] - curves(low)[0], 10.0, atol=1e-6)  # cm
    moving = clip.qpos.copy()
    moving[:, :3] = np.arange(60)[:, None] * (0.006, 0.0, 0.008)  # in frames of 0.02 s
    root = motion_plot(replace(clip, qpos=moving), validate_motion(clip)).axes[3]
    np.testing.assert_allclose(curves(root)[0], 0.5, atol=1e-6)


def test_limits_are_lines_and_findings_are_marked():
    clip = bowing_clip(60)
    clip.qpos[30:, 0] += 2.0
    clip.qpos[20, 7:] += 0.3
    limits = ValidationLimits(joint_speed=33.0)
    report = validate_motion(clip, G1, limits)
    assert report.jumps
    assert report.steps
    figure = motion_plot(clip, report, limits)
    speeds = figure.axes[2]
    assert any(len(line) == 2 and set(line) == {33.0} for line in curves(speeds))
    assert sum(line.get_marker() == "x" for line in speeds.lines) == len(report.steps)
    for panel in figure.axes[:3]:
        dotted = [line.get_xdata()[0] for line in panel.lines if line.get_linestyle() == ":"]
        assert dotted == list(report.jumps)
