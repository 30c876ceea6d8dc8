import torch

from plat.envs import MotionTrackingEnv
from plat.envs.transforms import ReferenceMotion, align_to_anchor
from plat.rotations import quat_angle, quat_from_rotvec, quat_multiply, quat_rotate, quat_yaw


def pose(count: int = 8) -> tuple[torch.Tensor, torch.Tensor]:
    tilt = 0.3 * torch.randn(count, 14, 3)
    return torch.randn(count, 14, 3), quat_from_rotvec(tilt)


def test_alignment_undoes_a_walk_and_a_turn():
    pos, quat = pose()
    turn = quat_from_rotvec(torch.tensor([0.0, 0.0, 1.3]))
    shift = torch.tensor([2.0, -1.0, 0.0])
    moved_pos = quat_rotate(turn, pos) + shift
    moved_quat = quat_multiply(turn.expand_as(quat), quat)
    # a robot that does the same elsewhere is met exactly
    aligned_pos, aligned_quat = align_to_anchor(pos, quat, moved_pos[:, 7], moved_quat[:, 7], anchor=7)
    torch.testing.assert_close(aligned_pos, moved_pos, atol=1e-5, rtol=0)
    assert quat_angle(aligned_quat, moved_quat).max() < 1e-3


def test_alignment_keeps_heights_and_tilts():
    pos, quat = pose()
    aligned_pos, aligned_quat = align_to_anchor(pos, quat, torch.randn(8, 3), pose()[1][:, 0], anchor=7)
    torch.testing.assert_close(aligned_pos[..., 2], pos[..., 2])
    up = torch.tensor([0.0, 0, 1])
    level = quat_multiply(torch.nn.functional.normalize(quat_yaw(aligned_quat), dim=-1), quat_yaw(aligned_quat))
    assert level.isfinite().all()
    torch.testing.assert_close(quat_rotate(aligned_quat, up)[..., 2], quat_rotate(quat, up)[..., 2], atol=1e-5, rtol=0)


def test_reference_is_the_librarys_frame(library):
    state = MotionTrackingEnv(library, 6).reset()
    out = ReferenceMotion(library).compute(state)
    expected = library.states(state["motion", "frame"])
    assert torch.equal(out["reference", "joint_vel"], expected["joint_vel"])
    # on the reference, aligned or not is the same
    torch.testing.assert_close(out["reference", "keypoint_pos_aligned_w"], expected["keypoint_pos"], atol=1e-4, rtol=0)


def test_a_reset_may_go_without(library):
    reset = MotionTrackingEnv(library, 6).reset()
    for at_resets in (True, False):
        out = ReferenceMotion(library, at_resets)._reset(reset.empty(), reset.copy())
        assert ("reference" in out) == at_resets
