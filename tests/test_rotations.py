import math

import pytest
import torch

from plat import rotations
from plat.rotations import (
    matrix_to_sixd,
    quat_angle,
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    quat_nlerp,
    quat_rotate,
    quat_rotate_inverse,
    quat_slerp,
    quat_to_matrix,
    quat_to_rotvec,
    quat_yaw,
    rows_times_matrices,
    yaw_multiply,
    yaw_rotate,
)


@pytest.fixture
def quats() -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(50, 4, dtype=torch.float64), dim=-1)


def test_rotation_forms_agree(quats):
    vec = torch.randn(50, 3, dtype=torch.float64)
    turned = quat_rotate(quats, vec)
    torch.testing.assert_close(turned, (quat_to_matrix(quats) @ vec[..., None])[..., 0])
    torch.testing.assert_close(quat_rotate_inverse(quats, turned), vec)
    torch.testing.assert_close((turned[:, None] @ quat_to_matrix(quats))[:, 0], vec)


@pytest.mark.parametrize("bound", ["on_gpu", "overhead_bound"])
def test_few_operations_say_the_same(bound, quats, monkeypatch):
    vec, other = torch.randn(7, 50, 3, dtype=torch.float64), quats.flip(0)
    pairs = [
        (quat_multiply, (quats, other)),
        (quat_rotate, (quats, vec)),
        (quat_rotate_inverse, (quats, vec)),
        (quat_to_matrix, (quats,)),
    ]
    for function, arguments in pairs:
        with monkeypatch.context() as patched:
            patched.setattr(rotations, bound, lambda tensor: False)
            many = function(*arguments)
            patched.setattr(rotations, bound, lambda tensor: True)
            torch.testing.assert_close(function(*arguments), many)


def test_many_rows_by_one_rotation(quats):
    vec, matrix = torch.randn(10, 5, 7, 3, dtype=torch.float64), quat_to_matrix(quats).view(10, 5, 3, 3)
    torch.testing.assert_close(rows_times_matrices(vec, matrix), vec @ matrix)
    torch.testing.assert_close(rows_times_matrices(vec, matrix[:, :1]), vec @ matrix[:, :1])
    learnt = matrix.clone().requires_grad_()
    rows_times_matrices(vec, learnt).sum().backward()
    assert learnt.grad is not None


def test_product_is_composition(quats):
    a, b = quats[:25], quats[25:]
    torch.testing.assert_close(quat_to_matrix(quat_multiply(a, b)), quat_to_matrix(a) @ quat_to_matrix(b))
    unit = quat_multiply(a, quat_conjugate(a))
    torch.testing.assert_close(unit, torch.tensor([1.0, 0, 0, 0], dtype=torch.float64).expand(25, 4))


def test_rotvec_round_trip():
    axis = torch.nn.functional.normalize(torch.randn(60, 3, dtype=torch.float64), dim=-1)
    angle = torch.linspace(0, math.pi - 1e-3, 60, dtype=torch.float64)[:, None]
    torch.testing.assert_close(quat_to_rotvec(quat_from_rotvec(axis * angle)), axis * angle, atol=1e-7, rtol=1e-6)


def test_rotvec_takes_the_short_way(quats):
    torch.testing.assert_close(quat_to_rotvec(-quats), quat_to_rotvec(quats))


def test_angle_of_known_turn():
    a = quat_from_rotvec(torch.tensor([0.3, -0.2, 0.5]))
    b = quat_multiply(a, quat_from_rotvec(torch.tensor([0.0, 0.7, 0.0])))
    assert quat_angle(a, b).item() == pytest.approx(0.7, abs=1e-6)
    assert quat_angle(a, -b).item() == pytest.approx(0.7, abs=1e-6)


def test_yaw_ignores_tilt():
    heading = quat_from_rotvec(torch.tensor([0.0, 0.0, 1.1]))
    tilted = quat_multiply(heading, quat_from_rotvec(torch.tensor([0.0, 0.4, 0.0])))
    torch.testing.assert_close(quat_yaw(tilted), heading)


def test_nlerp_is_on_the_arc_of_slerp(quats):
    a, b = quats[:25], quats[25:50]
    for weight in (0.0, 0.5, 1.0):  # elsewhere at another speed
        weights = torch.full((len(a),), weight, dtype=a.dtype)
        assert float(quat_angle(quat_nlerp(a, b, weights), quat_slerp(a, b, weights)).max()) < 1e-6
    quarter = quat_nlerp(a, b, torch.full((len(a),), 0.25, dtype=a.dtype))
    assert torch.allclose(quarter.norm(dim=-1), torch.ones(len(a), dtype=a.dtype))
    assert torch.allclose(quat_angle(a, quarter) + quat_angle(quarter, b), quat_angle(a, b), atol=1e-6)


def test_slerp_halves_the_angle(quats):
    a, b = quats[:25], quats[25:]
    middle = quat_slerp(a, b, torch.full((25,), 0.5, dtype=torch.float64))
    torch.testing.assert_close(quat_angle(a, middle), quat_angle(middle, b))
    torch.testing.assert_close(quat_angle(a, middle) * 2, quat_angle(a, b))


def test_sixd_is_the_first_two_columns(quats):
    matrix = quat_to_matrix(quats)
    torch.testing.assert_close(matrix_to_sixd(matrix), torch.cat((matrix[..., 0], matrix[..., 1]), -1))


def test_rotations_about_the_vertical_are_the_general_ones(quats):
    quat, vec = quats[:45].view(5, 9, 4), torch.randn(5, 9, 3, dtype=torch.float64)
    yaw = quat_yaw(quats[45:, None])
    torch.testing.assert_close(yaw_multiply(yaw, quat), quat_multiply(yaw.expand_as(quat), quat))
    torch.testing.assert_close(yaw_rotate(yaw, vec), quat_rotate(yaw, vec))


def test_small_and_large_angles_are_exact(quats):
    start, axis = quats[0].float(), torch.tensor([0.6, 0.0, -0.8])
    for angle in (0.0, 1e-5, 1e-3, 1.0, 3.0):
        turned = quat_multiply(start, quat_from_rotvec(angle * axis))
        assert quat_angle(start, turned).item() == pytest.approx(angle, abs=1e-6)
        assert quat_angle(start, -turned).item() == pytest.approx(angle, abs=1e-6)
