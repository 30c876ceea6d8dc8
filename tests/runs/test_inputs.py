import copy
from dataclasses import replace

import torch
from torch import nn

from plat.motions import MotionLibrary, generate_motions
from plat.robots import G1
from plat.runs.inputs import changed_inputs, motions_print, robot_print, run_inputs, weights_print

CLIPS = generate_motions("train", seconds=8)


def clips():
    return [replace(clip, qpos=clip.qpos.copy()) for clip in CLIPS]


def difference(change) -> list[str]:
    """What is said of two libraries, the second of which has changed clips."""
    changed = clips()
    changed = change(changed) or changed
    before, now = (run_inputs(MotionLibrary.from_clips(some)) for some in (clips(), changed))
    return changed_inputs(before, now)


def test_the_same_motions_are_the_same_and_rounding_does_not_count():
    assert difference(lambda clips: None) == []
    prints = motions_print(MotionLibrary.from_clips(clips()))
    rounded = [[name, frames, first + 1e-7, second - 1e-7] for name, frames, first, second in prints]
    assert changed_inputs({"motions": prints}, {"motions": rounded}) == []


def test_a_motion_less_is_said():
    (said,) = difference(lambda clips: clips[:-1])
    assert said.startswith("motions: ")
    assert said == "motions: 1 clip, were 2"


def test_motions_in_another_order_are_said():
    (said,) = difference(lambda clips: [clips[1], clips[0], *clips[2:]])
    assert said.startswith("motions: clip 0 is '")


def test_a_motion_of_other_content_is_said():
    def bend(clips):
        clips[1].qpos[len(clips[1].qpos) // 2, 10] += 0.1  # one joint in one frame

    (said,) = difference(bend)
    assert said == f"motions: clip 1 {clips()[1].name!r} has other content"


def test_a_motion_backwards_is_said():
    (said,) = difference(lambda clips: [replace(clips[0], qpos=clips[0].qpos[::-1].copy()), *clips[1:]])
    assert "clip 0" in said
    assert "has other content" in said


def test_weights_and_robots():
    module = nn.Linear(3, 2)
    before = weights_print(module)
    assert weights_print(copy.deepcopy(module)) == before
    with torch.no_grad():
        module.bias[1] += 1e-6
    assert weights_print(module) != before
    assert robot_print(G1) == robot_print(replace(G1, asset=str(G1.asset_path.resolve())))
    assert robot_print(G1) != robot_print(replace(G1, root_height=0.7))
    assert changed_inputs({"robot": "a"}, {"robot": "b"}) == ["robot: other content"]
    assert changed_inputs({}, {"robot": "b"}) == []


def test_what_a_robots_file_includes_belongs_to_it(tmp_path):
    (tmp_path / "robot.xml").write_text(
        G1.asset_path.read_text().replace("</mujoco>", '<include file="more.xml"/></mujoco>')
    )
    robot, prints = replace(G1, asset=str(tmp_path / "robot.xml")), set()
    for mass in (1, 2):
        more = f'<worldbody><body name="beside"><geom size=".1" mass="{mass}" contype="0"/></body></worldbody>'
        (tmp_path / "more.xml").write_text(f"<mujoco>{more}</mujoco>")
        prints |= {robot_print(robot)}
    assert len(prints) == 2
