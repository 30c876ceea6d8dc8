import pytest
import torch
from tensordict import TensorDict

from plat.envs import GeneralizedState, MotionTrackingEnv, ResetNoise, joint_target
from plat.errors import ObservationError
from plat.modules import DynamicsConfig, DynamicsModel
from plat.objectives import DynamicsLoss, muon_and_adam
from plat.robots import G1


def windows(library, robots=64, steps=5):
    """Simulated windows of robots that are driven by small random actions."""
    env = MotionTrackingEnv(library, robots, reset_noise=ResetNoise(), min_frames_left=steps + 2)
    tensordict, states, actions = env.reset(), [], []
    for _ in range(steps):
        states.append(GeneralizedState.from_entries(tensordict).pack())
        actions.append(0.3 * torch.randn(robots, 29))
        tensordict = env.step(tensordict.set("action", actions[-1]))["next"]
    return TensorDict({"robot_state": torch.stack(states, 1), "action": torch.stack(actions, 1)}, [robots, steps])


def test_the_model_learns_what_the_robot_does(library):
    data = windows(library)
    states = GeneralizedState.unpack(data["robot_state"])
    before, after = (GeneralizedState(*(field[:, part] for field in states)) for part in (slice(0, -1), slice(1, None)))
    model = DynamicsModel(G1, DynamicsConfig(hidden=(64, 64)))
    for _ in range(3):
        model.update_statistics(before, joint_target(G1, data["action"][:, :-1]), after)
    loss = DynamicsLoss(model)
    optimizers = muon_and_adam(model.network, 4e-3, 1e-3)
    first = loss(data)["loss_dynamics"].item()
    for _ in range(120):
        losses = loss(data)
        losses["loss_dynamics"].backward()
        for optimizer in optimizers:
            optimizer.step()
            optimizer.zero_grad()
    assert losses["loss_dynamics"].item() < 0.6 * first
    assert losses["joint_pos_error"].item() < 0.1


def test_a_perfect_model_has_no_loss(library):
    data = windows(library, steps=2)
    model = DynamicsModel(G1)
    before, after = (GeneralizedState.unpack(data["robot_state"][:, step]) for step in (0, 1))

    class Told(torch.nn.Module):
        def forward(self, inputs):
            return model._change(before, after)

    model.network = Told()
    losses = DynamicsLoss(model)(data)
    assert float(losses["root_pos_error"]) < 1e-5
    # rounded at 0, where an angle has no gradient: that much is left
    assert float(losses["root_rot_error"]) < 1e-3
    model.network = torch.nn.Linear(97, 70)
    assert float(DynamicsLoss(model)(data)["root_pos_error"]) > 1e-3


def test_keys_can_be_named(library):
    data = windows(library, robots=4)
    loss = DynamicsLoss(DynamicsModel(G1, DynamicsConfig(hidden=(8,))))
    wanted = loss(data)["loss_dynamics"]
    loss.set_keys(state=("robot", "all"))
    renamed = data.rename_key_("robot_state", ("robot", "all"))
    assert loss(renamed)["loss_dynamics"].equal(wanted)


def test_randomized_robots_are_told_of_by_an_entry_that_is_read(library):
    data, model = windows(library, robots=8), DynamicsModel(G1, DynamicsConfig(hidden=(8,)))
    nominal = DynamicsLoss(model)(data)["loss_dynamics"]
    data["memory"] = TensorDict({"encoder_bias": torch.full((8, 5, 29), 0.5)}, [8, 5])
    loss = DynamicsLoss(model)
    told = loss(data)["loss_dynamics"]
    assert told != nominal
    assert loss(data.select(*loss.in_keys))["loss_dynamics"] == told
    assert loss(robot_state=data["robot_state"], action=data["action"], memory=data["memory"])[0] == told
    assert loss(robot_state=data["robot_state"], action=data["action"])[0] == nominal
    loss.set_keys(memory=("told", "memory"))
    data["told"] = TensorDict({"memory": data.pop("memory")}, [8])
    assert loss(data)["loss_dynamics"] == told


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: data.select("action"), r"no entry 'robot_state', expected one of shape \[\*B, K \+ 1, 71\]"),
        (lambda data: data.select("robot_state"), "no entry 'action'"),
        (
            lambda data: data.set("robot_state", data["robot_state"][..., :60]),
            r"'robot_state' has shape \(2, 5, 60\), expected \[\*B, K \+ 1, 71\]",
        ),
        (lambda data: data[:, :1], r"windows \(2, 1\), expected \[B, K \+ 1\] with K at least 1"),
        (lambda data: data[0], r"windows \(5,\), expected"),
    ],
)
def test_windows_that_are_none_are_refused_by_name(spoil, message):
    state = torch.nn.functional.pad(torch.ones(2, 5, 1), (3, 67))
    data = TensorDict({"robot_state": state, "action": torch.zeros(2, 5, 29)}, [2, 5])
    with pytest.raises(ObservationError, match=f"^dynamics loss: .*{message}"):
        DynamicsLoss(DynamicsModel(G1, DynamicsConfig(hidden=(16,))))(spoil(data))


@pytest.mark.parametrize("memory", [False, True])
def test_some_of_its_entries_are_selected_as_of_any_loss(memory):
    state = torch.nn.functional.pad(torch.ones(2, 5, 1), (3, 67))
    data = TensorDict({"robot_state": state, "action": torch.zeros(2, 5, 29)}, [2, 5])
    if memory:
        data["memory"] = TensorDict({"last_action": torch.zeros(2, 5, 29)}, [2, 5])
    before = set(data.keys(True))
    loss = DynamicsLoss(DynamicsModel(G1, DynamicsConfig(hidden=(16,))))
    whole = loss(data)
    for names in (["loss_dynamics"], ["loss_dynamics", "root_pos_error"]):
        selected = loss.select_out_keys(*names)(data)
        assert sorted(selected.keys()) == names
        loss.reset_out_keys()
    assert selected["loss_dynamics"] == whole["loss_dynamics"] == loss(**data)[0]
    assert set(data.keys(True)) == before
