import pytest
import torch
from torch.autograd import gradcheck, gradgradcheck

from plat.robots import G1, frames
from plat.robots.frames import BodyFrames


@pytest.fixture
def arm():
    """Both shoulders up to the elbows, by the waist, and a hand that no joint turns."""
    model = G1.shared_model
    named = [model.body(name).id for name in _BODIES]
    return BodyFrames(model, named, parents=_PARENTS, joints=[_joint(body) for body in named])


_BODIES = (
    *("waist_yaw_link", "waist_roll_link", "torso_link", "left_shoulder_pitch_link", "right_shoulder_pitch_link"),
    *("left_shoulder_roll_link", "right_shoulder_roll_link"),
)
_PARENTS = (0, 1, 2, 3, 3, 4, 5)


def _joint(body: int) -> int:
    return int(G1.shared_model.body_jntadr[body]) - 1


def _angles(count: int = 3) -> torch.Tensor:
    return torch.linspace(-0.9, 1.1, count * G1.num_joints, dtype=torch.float64).view(count, -1)


def test_gradients_of_any_order_match_finite_differences(arm):
    joint_pos = _angles(2).requires_grad_()
    assert gradcheck(arm, (joint_pos,))
    assert gradgradcheck(lambda angles: arm(angles)[1].square(), (joint_pos,))
    assert gradgradcheck(lambda angles: arm(angles)[0].square(), (joint_pos,))


def test_a_gpu_composes_otherwise_and_finds_the_same(arm, monkeypatch):
    wanted = arm(_angles())
    monkeypatch.setattr(frames, "on_gpu", lambda tensor: True)
    torch.testing.assert_close(arm(_angles()), wanted)


def test_function_transforms_go_through(arm):
    joint_pos = _angles(2)
    jacobian = torch.func.vmap(torch.func.jacrev(lambda angles: arm(angles)[1]))(joint_pos)
    for row in range(2):
        one = torch.autograd.functional.jacobian(lambda angles: arm(angles)[1], joint_pos[row])
        torch.testing.assert_close(jacobian[row], one)


def test_a_joint_that_turns_none_of_the_bodies_moves_nothing(arm):
    joint_pos = _angles().requires_grad_()
    arm(joint_pos)[1].sum().backward()
    moving = sorted({_joint(G1.shared_model.body(name).id) for name in _BODIES})
    assert joint_pos.grad[:, moving].abs().sum() > 0
    others = [joint for joint in range(G1.num_joints) if joint not in moving]
    assert joint_pos.grad[:, others].abs().max() == 0


def test_a_body_without_a_joint_goes_with_its_parent():
    model = G1.shared_model
    torso = model.body("torso_link").id
    alone = BodyFrames(model, [torso], parents=[0], joints=[-1])
    _, origin = alone(torch.zeros(G1.num_joints))
    torch.testing.assert_close(origin[1].double(), torch.from_numpy(model.body_pos[torso]), atol=1e-6, rtol=0)
    joint_pos = torch.randn(4, G1.num_joints, requires_grad=True)
    turned, moved = alone(joint_pos)
    torch.testing.assert_close(moved[:, 1], origin[1].expand(4, 3))
    assert torch.autograd.grad(turned.sum() + moved.sum(), joint_pos)[0].abs().max() == 0
