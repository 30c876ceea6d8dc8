import pytest
import torch
from tensordict import TensorDict

from plat.envs.transforms import ObservationTransform, Statistics
from plat.errors import TaskError


class Double(ObservationTransform):
    def __init__(self):
        super().__init__(["x"], {("group", "twice"): (2,)})
        self.seen = []

    def compute(self, tensordict):
        self.seen.append(len(tensordict["x"]))
        return {("group", "twice"): 2 * tensordict["x"]}


def test_partial_resets_compute_only_their_rows():
    transform = Double()
    mask = torch.tensor([[False], [True], [False], [True]])
    out = transform._reset(TensorDict({"_reset": mask}, [4]), TensorDict({"x": torch.arange(8.0).view(4, 2)}, [4]))
    assert transform.seen == [2]
    assert out["group", "twice"][mask[:, 0]].tolist() == [[4.0, 6.0], [12.0, 14.0]]


def test_whole_resets_and_steps_compute_all_rows():
    transform = Double()
    data = TensorDict({"x": torch.ones(3, 2)}, [3])
    transform._reset(TensorDict({}, [3]), data.clone())
    transform._step(data, data.clone())
    assert transform.seen == [3, 3]


def test_an_entry_that_in_keys_do_not_name_is_told_where_a_part_is_reset():
    class Other(Double):
        def compute(self, tensordict):
            return {("group", "twice"): 2 * tensordict["y"]}

    data = TensorDict({"x": torch.ones(2, 2), "y": torch.ones(2, 2)}, [2])
    mask = TensorDict({"_reset": torch.tensor([[True], [False]])}, [2])
    with pytest.raises(TaskError, match=r"Other reads an entry that its in_keys do not name: .*\"y\""):
        Other()._reset(mask, data)


def test_statistics_weigh_elements_alike():
    statistics = Statistics()
    statistics.add("a", torch.zeros(3))
    statistics.add("a", torch.ones(1))
    statistics.add("b", torch.tensor([5.0]))
    assert statistics.pop() == {"a": 0.25, "b": 5.0}
    assert statistics.pop() == {}
