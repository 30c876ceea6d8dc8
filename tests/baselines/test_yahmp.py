import pytest
import torch

from plat.baselines import Yahmp
from plat.motions import MotionLibrary
from plat.robots import G1
from tests.baselines.test_wbc import situation

WRISTS = [index for index, name in enumerate(G1.joint_names) if "wrist" in name]


@pytest.fixture
def seen(monkeypatch) -> list[torch.Tensor]:
    """What the network is shown; it answers with ones."""
    rows: list[torch.Tensor] = []

    class Recorder:
        def __init__(self, path, inputs, outputs):
            assert (inputs, outputs) == (11 * 157, 29)

        def constant(self, name):
            return torch.zeros(157) if "mean" in name else torch.full((157,), 100.0)

        def __call__(self, observation):
            rows.append(observation)
            return torch.ones(len(observation), 29)

    monkeypatch.setattr("plat.baselines.yahmp.OnnxPolicy", Recorder)
    return rows


def complete(starting: bool):
    entries = situation(starting)
    entries["tracker_reference", "joint_vel"] = 0.1 * torch.arange(29.0)[None]
    entries["tracker_reference", "root_pos_w"] = torch.tensor([[5.0, 6.0, 0.71]])
    return entries


def test_what_it_sees(seen):
    Yahmp("anywhere")(complete(starting=True))
    block = seen[0][0, :157]
    others = [index for index in range(29) if index not in WRISTS]
    assert block[others].tolist() == pytest.approx(others)
    assert block[[29 + index for index in others]].tolist() == pytest.approx([0.1 * index for index in others])
    # the reference faces along y: its own forward is the world's y
    assert block[58:64].tolist() == pytest.approx([0.5, 0.0, 0.2, 0.71, 0.0, 0.0], abs=1e-5)
    assert block[64:70].tolist() == pytest.approx([0.4, 0.8, 1.2, 0.0, 0.6, -0.8])
    default = -G1.default_joint_pos
    torch.testing.assert_close(block[70:99][others], default[others])
    assert (block[99:128][others] == 2.0).all()
    assert (block[128:] == 0).all()


def test_wrists_are_seen_from_their_reference(seen):
    Yahmp("anywhere")(complete(starting=True))
    block = seen[0][0, :157]
    for index in WRISTS:
        assert block[index] == block[29 + index] == 0
        assert block[70 + index] == pytest.approx(float(-G1.default_joint_pos[index]) - index)
        assert block[99 + index] == pytest.approx(2.0 - 0.1 * index, abs=1e-5)


def test_history_is_filled_by_the_first_block_and_then_moves_on(seen):
    tracker = Yahmp("anywhere")
    for starting in (True, False, False):
        tracker(complete(starting))
    first, second, third = (row[0].view(11, 157) for row in seen)
    assert torch.equal(first[1:], first[:1].expand(10, -1))
    assert (second[0, 128:] == 1).all()
    assert torch.equal(second[1:], first[:1].expand(10, -1))  # the present block is not in its own history
    assert torch.equal(third[10], second[0])
    assert torch.equal(third[9], first[0])


def test_the_command_is_kept_within_its_training_data(seen, monkeypatch):
    tracker = Yahmp("anywhere")
    tracker._highest = torch.full((64,), 3.0)
    tracker(complete(starting=True))
    assert seen[0][0, :64].max() == 3.0
    assert seen[0][0, 99] == 2.0  # measurements are as they are


def test_its_action_is_added_to_the_reference(seen):
    action = Yahmp("anywhere")(complete(starting=True))["action"]
    targets = (G1.default_joint_pos + G1.action_scale * action)[0]
    torch.testing.assert_close(targets, torch.arange(29.0) + G1.action_scale, atol=1e-4, rtol=0)


def test_the_released_file_tracks(shared_data):
    pytest.importorskip("onnx")
    from plat.evaluation import Entrant, report
    from plat.motions import load_motions

    clips = load_motions(shared_data / "motions" / "pbhc_train.npz")[:1]
    tracker = Yahmp(shared_data / "baselines" / "yahmp" / "g1_yahmp.onnx")
    library = MotionLibrary.from_clips(clips)
    figures = report(Entrant.of_tracker(tracker, dense=True).evaluate(library, "long", num_threads=1), resamples=5)
    assert figures["tks"].value > 60
    assert figures["mpjpe"].value < 0.2
