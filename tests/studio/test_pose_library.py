import numpy as np

from plat.motions import MotionClip, MotionLibrary
from plat.robots import G1
from plat.studio.pose_library import PoseLibrary
from tests.studio.conftest import squat


def library() -> PoseLibrary:
    """Down and up again in two seconds, and an arm that is raised."""
    raised = G1.default_qpos.copy()
    raised[7 + G1.joint_names.index("right_shoulder_pitch")] = -2.6
    share = (1 - np.cos(np.linspace(0, 2 * np.pi, 61)))[:, None] / 2
    clips = [
        MotionClip(name, G1.default_qpos + share * (pose - G1.default_qpos), 30.0)
        for name, pose in (("kneel", squat()), ("reach", raised))
    ]
    return PoseLibrary.of(MotionLibrary.from_clips(clips), G1)


def test_poses_are_taken_where_the_motion_turns_around():
    times = [round(pose.time, 1) for pose in library().poses if pose.name == "kneel"]
    assert 1.0 in times
    assert 0.0 in times
    assert len(times) <= 4


def test_poses_are_found_by_what_they_are_like_and_by_their_clip():
    found = library()
    assert {pose.name for pose in found.search("right hand up")} == {"reach"}
    assert {pose.name for pose in found.search("KNEEL")} == {"kneel"}
    assert not found.search("kneel right hand up")
    assert len(found.search("")) == len(found.poses)
