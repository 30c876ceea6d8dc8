import numpy as np
import pytest
import torch

from plat import rotations, rotations_np


@pytest.fixture
def quats() -> np.ndarray:
    random = np.random.default_rng(0).normal(size=(20, 4))
    return random / np.linalg.norm(random, axis=-1, keepdims=True)


def test_products_and_matrices_are_those_of_the_torch_twin(quats):
    a, b = quats[:10], quats[10:]
    theirs = rotations.quat_multiply(torch.from_numpy(a), torch.from_numpy(b)).numpy()
    np.testing.assert_allclose(rotations_np.quat_multiply(a, b), theirs, atol=1e-14)
    matrices = rotations.quat_to_matrix(torch.from_numpy(quats)).numpy()
    for quat, matrix in zip(quats, matrices, strict=True):
        np.testing.assert_allclose(rotations_np.quat_to_matrix(3.0 * quat), matrix, atol=1e-14)


@pytest.mark.parametrize("scale", [0.0, 1e-12, 1.0, 3.0])
def test_rotation_vectors_are_those_of_the_torch_twin(scale):
    vectors = scale * np.random.default_rng(1).normal(size=(20, 3))
    theirs = rotations.quat_from_rotvec(torch.from_numpy(vectors)).numpy()
    np.testing.assert_allclose(rotations_np.quat_from_rotvec(vectors), theirs, atol=1e-12)


@pytest.mark.parametrize("weight", [0.0, 0.3, 1.0])
def test_interpolation_is_that_of_the_torch_twin(quats, weight):
    for a, b in zip(quats[:10], quats[10:], strict=True):
        ours = rotations_np.quat_slerp(a, b, weight)
        theirs = rotations.quat_slerp(*(torch.from_numpy(quat)[None] for quat in (a, b)), torch.tensor([weight]))
        assert abs(ours @ theirs.numpy()[0]) == pytest.approx(1.0, abs=1e-6)


def test_equal_quaternions_have_a_point_between_them(quats):
    np.testing.assert_allclose(rotations_np.quat_slerp(quats[0], quats[0], 0.4), quats[0], atol=1e-15)


def test_angles_there_and_back():
    angles = np.array([2.0, -0.7, 0.4])
    quat = rotations_np.quat_from_heading_pitch_roll(angles)
    np.testing.assert_allclose(rotations_np.heading_pitch_roll(quat), angles)
    matrix = np.eye(3)
    for axis, angle in zip((2, 1, 0), angles, strict=True):
        matrix = matrix @ rotations_np.axis_rotation(axis, np.array([angle]))[0]
    np.testing.assert_allclose(rotations_np.quat_to_matrix(quat), matrix, atol=1e-14)
