import torch
from tensordict import TensorDict

from plat.baselines import TrackerReference
from plat.baselines.tracker_reference import PlannedReference
from plat.envs.state import GeneralizedState
from plat.motions import MotionLibrary
from tests.conftest import standing_clip


def shown(frame: list[int], **kwargs) -> TensorDict:
    library = MotionLibrary.from_clips([standing_clip()])
    rows = torch.tensor(frame)
    tensordict = TensorDict({"motion": TensorDict({"frame": rows}, [len(frame)])}, [len(frame)])
    return TrackerReference(library, **kwargs)._call(tensordict)["tracker_reference"]


def test_the_frame_ahead_is_shown():
    reference = shown([10, 20], ahead=5)
    torch.testing.assert_close(reference["root_pos_w"][:, 0], torch.tensor([0.3 * 15 * 0.02, 0.3 * 25 * 0.02]))
    torch.testing.assert_close(reference["root_lin_vel_w"], torch.tensor([[0.3, 0, 0]] * 2), atol=2e-3, rtol=0)
    torch.testing.assert_close(reference["root_ang_vel_w"], torch.tensor([[0, 0, 0.5]] * 2), atol=2e-3, rtol=0)


def test_past_the_end_the_last_frame_is_shown():
    reference = shown([99, 100], ahead=1)
    assert torch.equal(reference["root_pos_w"][0], reference["root_pos_w"][1])


def test_a_keyframe_has_no_velocity():
    reference = shown([10], velocities=False)
    assert (reference["root_lin_vel_w"] == 0).all()
    assert (reference["root_ang_vel_w"] == 0).all()


def test_any_entry_may_name_the_frame():
    library = MotionLibrary.from_clips([standing_clip()])
    tensordict = TensorDict({"command": TensorDict({"target_frame": torch.tensor([50])}, [1])}, [1])
    shown = TrackerReference(library, ("command", "target_frame"), ahead=0)._call(tensordict)["tracker_reference"]
    torch.testing.assert_close(shown["root_pos_w"][0], library.frames["keypoint_pos"][50, 0])
    torch.testing.assert_close(shown["anchor_pos_w"][0], library.frames["keypoint_pos"][50, library.robot.anchor_index])


def test_several_frames_at_once():
    together = shown([10, 98], ahead=(0, 5, 1))
    assert together.shape == (2,)
    assert together["joint_pos"].shape == together["joint_vel"].shape == (2, 3, 29)
    for number, ahead in enumerate((0, 5, 1)):
        alone = shown([10, 98], ahead=ahead)
        for key, value in alone.items():
            assert torch.equal(together[key][:, number], value)
    assert torch.equal(together["root_pos_w"][1, 1], shown([100], ahead=0)["root_pos_w"][0])  # the clip's last frame


def test_a_planned_reference_is_the_line_to_the_keyframe():
    library = MotionLibrary.from_clips([standing_clip()])
    start = GeneralizedState.from_motion(library.states(torch.tensor([0])))
    tensordict = TensorDict(
        {
            "command": {"target_frame": torch.tensor([50]), "steps_left": torch.tensor([[40]])},
            "plan": {"start": start.pack(), "length": torch.tensor([[50]])},
        },
        [1],
    )
    planned = PlannedReference(library, "line", (1, 11))._call(tensordict)["tracker_reference"]
    motion = shown([10], ahead=(1, 11))
    assert planned.keys() == motion.keys()
    for key, value in motion.items():
        torch.testing.assert_close(planned[key], value, atol=3e-3, rtol=0)
