import pytest
import torch
from torch import nn

from plat.errors import ObservationError, PlatError
from plat.modules import GoalSequenceEncoder


@pytest.fixture
def encoder() -> GoalSequenceEncoder:
    return GoalSequenceEncoder(6, 5)


def test_padding_equals_running_each_sequence_alone(encoder):
    goals, length = torch.randn(8, 9, 6), torch.randint(1, 10, (8,))
    together = encoder(goals, length)
    for row in range(8):
        alone = encoder(goals[row : row + 1, : length[row]], length[row : row + 1])
        torch.testing.assert_close(together[row : row + 1], alone)


def test_order_matters(encoder):
    goals, length = torch.randn(1, 4, 6), torch.tensor([4])
    assert not torch.allclose(encoder(goals, length), encoder(goals.flip(1), length))


def test_batches_of_any_depth(encoder):
    goals, length = torch.randn(2, 3, 4, 6), torch.randint(1, 5, (2, 3))
    code = encoder(goals, length)
    assert code.shape == (2, 3, 5)
    torch.testing.assert_close(code.flatten(0, 1), encoder(goals.flatten(0, 1), length.flatten()))


def test_a_single_sequence_and_none(encoder):
    goals, length = torch.randn(2, 4, 6), torch.tensor([4, 2])
    torch.testing.assert_close(encoder(goals[1], length[1]), encoder(goals, length)[1])
    none = encoder(goals[:0], length[:0])
    assert none.shape == (0, 5)
    none.sum().backward()
    assert encoder.module.gru.weight_hh_l0.grad.abs().sum() == 0


@pytest.mark.parametrize(("frames", "lengths"), [(4, [4, 0]), (4, [0] * 40), (0, [0, 0])])
def test_a_sequence_without_frames_is_refused(encoder, frames, lengths):
    with pytest.raises(ObservationError, match="goal encoder: a goal sequence has no frames, expected a length"):
        encoder(torch.randn(len(lengths), frames, 6), torch.tensor(lengths))


def test_a_gradient_of_the_gradient_is_refused_by_name(encoder):
    goals = torch.randn(2, 4, 6, requires_grad=True)
    code = encoder(goals, torch.tensor([4, 2])).sum()
    with pytest.raises(PlatError, match="goal encoder: its gradient has no gradient, expected create_graph=False"):
        torch.autograd.grad(code, goals, create_graph=True)


def test_gradients_reach_all_frames_of_the_sequence_and_no_padding(encoder):
    goals = torch.randn(1, 5, 6, requires_grad=True)
    encoder(goals, torch.tensor([3])).sum().backward()
    used = goals.grad.abs().sum(-1)[0] > 0
    assert used.tolist() == [True, True, True, False, False]


@pytest.mark.parametrize("rows", [1, 7, 20, 33])
def test_any_number_of_sequences_that_all_go_on(encoder, rows):
    length = torch.full((rows,), 4)
    goals = torch.randn(rows, 4, 6)
    torch.testing.assert_close(encoder(goals, length)[:1], encoder(goals[:1], length[:1]))


def test_states_and_gradients_are_those_of_the_gru_of_pytorch(encoder):
    encoder = encoder.double()
    goals, length = torch.randn(40, 7, 6, dtype=torch.float64), torch.randint(1, 8, (40,))
    along = torch.randn(40, 5, dtype=torch.float64)
    parameters = list(encoder.parameters())
    network = encoder.module
    packed = nn.utils.rnn.pack_padded_sequence(network.embed(goals.transpose(0, 1)), length, enforce_sorted=False)
    wanted = network.gru(packed)[1][0]
    code = encoder(goals, length)
    torch.testing.assert_close(code, wanted)
    torch.testing.assert_close(
        torch.autograd.grad((code * along).sum(), parameters), torch.autograd.grad((wanted * along).sum(), parameters)
    )


def test_half_precision_is_close(encoder):
    goals, length = torch.randn(64, 11, 6), torch.randint(1, 12, (64,))
    code = encoder(goals, length)
    with torch.autocast("cpu", torch.bfloat16):
        half = encoder(goals, length)
    assert (half - code).abs().max() < 0.03
