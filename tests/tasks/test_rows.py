import torch

from plat.tasks.rows import for_some


def test_only_those_that_count_are_computed_on_a_cpu():
    asked = []

    def compute(rows):
        asked.append(rows.tolist())
        return torch.ones(len(rows))

    assert for_some(torch.tensor([False, True, True]), compute).tolist() == [0, 1, 1]
    assert asked == [[1, 2]]


def test_nothing_is_computed_for_nobody():
    def compute(rows):
        raise AssertionError

    assert for_some(torch.zeros(3, dtype=torch.bool), compute).tolist() == [0, 0, 0]


def test_elsewhere_the_shape_is_known():
    counts = torch.zeros(3, dtype=torch.bool, device="meta")
    assert for_some(counts, lambda rows: torch.empty(3, device="meta")[rows]).shape == (3,)


def test_gradients_reach_those_alone():
    values = torch.tensor([1.0, 2.0, 3.0], requires_grad=True)
    for_some(torch.tensor([True, False, True]), lambda rows: values[rows].square()).sum().backward()
    assert values.grad.tolist() == [2, 0, 6]
