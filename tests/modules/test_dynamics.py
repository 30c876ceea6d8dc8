import pytest
import torch

from plat.envs import GeneralizedState, MotionTrackingEnv, ResetNoise, joint_target
from plat.errors import ActionError, ConfigError, ObservationError, PlatError
from plat.modules import DynamicsConfig, DynamicsModel
from plat.robots import G1
from plat.rotations import quat_from_rotvec, quat_multiply, quat_rotate, quat_yaw


def steps(library, length=3):
    """States of a few robots before and after a control step, and the targets that moved them."""
    rollout = MotionTrackingEnv(library, 16, reset_noise=ResetNoise()).rollout(length, break_when_any_done=False)
    kept = rollout.reshape(-1)
    kept = kept[~kept["next", "done"][:, 0]]
    action = kept.get("action")
    return GeneralizedState.from_entries(kept), joint_target(G1, action), GeneralizedState.from_entries(kept["next"])


class Told(torch.nn.Module):
    """Stands in for the network: says what it was told."""

    def __init__(self, output):
        super().__init__()
        self.output = output

    def forward(self, inputs):
        return self.output


def test_the_right_change_gives_the_next_state(library):
    state, target, after = steps(library)
    model = DynamicsModel(G1)
    model.network = Told(model._change(state, after))
    for ours, theirs in zip(model(state, target), after, strict=True):
        torch.testing.assert_close(ours, theirs, atol=2e-5, rtol=1e-4)


def test_place_and_heading_do_not_matter(library):
    state, target, _ = steps(library)
    model = DynamicsModel(G1, DynamicsConfig(hidden=(32,)))
    turn = quat_yaw(quat_from_rotvec(torch.tensor([0.0, 0.0, 1.2])))
    shift = torch.tensor([3.0, -2.0, 0.0])

    def moved(robots):
        return robots._replace(
            root_pos_w=quat_rotate(turn, robots.root_pos_w) + shift,
            root_quat_w=quat_multiply(turn.expand_as(robots.root_quat_w), robots.root_quat_w),
            root_lin_vel_w=quat_rotate(turn, robots.root_lin_vel_w),
        )

    for ours, theirs in zip(model(moved(state), target), moved(model(state, target)), strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-5)


def test_statistics_scale_inputs_and_outputs(library):
    state, target, after = steps(library)
    model = DynamicsModel(G1)
    model.update_statistics(state, target, after)
    features = model._features(state, target)[0]
    torch.testing.assert_close(features.mean(0), model.mean)
    torch.testing.assert_close(model._change(state, after).std(0).clamp_min(1e-6), model.spread)
    for _ in range(3):
        model.update_statistics(state, target, after)
    spread = model.spread.clone()
    model.update_statistics(after, target, state)
    assert model.spread.equal(spread)


def told_of_physics(library, num_parameters):
    """A model that has seen robots of all kinds, some more than nominal, and what it takes for steps."""
    state, target, after = steps(library)
    model = DynamicsModel(G1, DynamicsConfig(hidden=(32,)), num_parameters=num_parameters)
    parameters = 0.3 + torch.rand(len(target), num_parameters)
    model.update_statistics(state, target, after, parameters)
    return model, state, target, parameters


@pytest.mark.parametrize("batches", [0, 3])
def test_statistics_of_steps_that_are_not_finite_are_refused(library, batches):
    state, target, after = steps(library)
    model = DynamicsModel(G1)
    for _ in range(batches):
        model.update_statistics(state, target, after)
    before = {name: value.clone() for name, value in model.state_dict().items()}
    broken = state._replace(joint_vel=state.joint_vel.clone())
    broken.joint_vel[3, 4] = torch.nan
    with pytest.raises(ActionError, match="dynamics model: states or joint targets hold NaN or infinity; nothing was"):
        model.update_statistics(broken, target, after)
    for count in (0, 1):  # one step has no spread
        model.update_statistics(state.at(slice(count)), target[:count], after.at(slice(count)))
    for name, value in model.state_dict().items():
        assert torch.equal(value, before[name]), name


def test_a_model_that_is_told_less_is_that_of_the_nominal_robot(library):
    trained, state, target, _ = told_of_physics(library, 5)
    model = DynamicsModel(G1, trained.config)
    before = {name: value.clone() for name, value in trained.state_dict().items()}
    model.take_over(trained)
    for ours, theirs in zip(model(state, target), trained(state, target), strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-5)
    assert all(before[name].equal(value) for name, value in trained.state_dict().items())


def test_a_model_that_is_told_more_makes_nothing_of_it_yet(library):
    trained, state, target, parameters = told_of_physics(library, 2)
    model = DynamicsModel(G1, trained.config, num_parameters=5)
    model.take_over(trained)
    more = torch.cat((parameters, torch.rand(len(target), 3)), -1)
    for ours, theirs in zip(model(state, target, more), trained(state, target, parameters), strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-5)


def test_a_model_of_another_shape_is_refused():
    with pytest.raises(ConfigError, match=r"hidden=\(16,\).*, expected .*hidden=\(32,\)"):
        DynamicsModel(G1, DynamicsConfig(hidden=(32,))).take_over(DynamicsModel(G1, DynamicsConfig(hidden=(16,))))


def test_statistics_of_unbatched_and_of_nested_steps(library):
    state, target, after = steps(library)
    whole, nested, single = (DynamicsModel(G1) for _ in range(3))
    even = len(target) // 2 * 2
    whole.update_statistics(*(parts_of(part, slice(even)) for part in (state, target, after)))
    nested.update_statistics(*(parts_of(part, slice(even), (2, -1)) for part in (state, target, after)))
    torch.testing.assert_close(nested.spread, whole.spread)
    torch.testing.assert_close(nested.std, whole.std)
    single.update_statistics(*(parts_of(part, 0) for part in (state, target, after)))
    assert int(single.batches) == 0
    assert single(parts_of(state, 0), target[0]).joint_pos.shape == (29,)


def parts_of(value, rows, shape=None):
    """Some rows of targets or of each part of states, in another shape."""
    if isinstance(value, GeneralizedState):
        return GeneralizedState(*(parts_of(part, rows, shape) for part in value))
    return value[rows] if shape is None else value[rows].unflatten(0, shape)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robot": "g1"}, "robot is 'g1', expected a Robot"),
        ({"config": (16,)}, "dynamics model: config is .16,., expected a DynamicsConfig or None"),
        ({"dt": 0.0}, "dynamics model: dt is 0.0, expected a number above 0"),
        ({"num_parameters": -1}, "dynamics model: num_parameters is -1"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(change, message):
    with pytest.raises(PlatError, match=message):
        DynamicsModel(**{"robot": G1, **change})


def test_what_is_of_another_width_is_refused(library):
    state, target, _ = steps(library)
    model = DynamicsModel(G1, DynamicsConfig(hidden=(8,)), num_parameters=3)
    with pytest.raises(ObservationError, match=r"target \(\d+, 1\), expected \[\*B, 29\]"):
        model(state, target[:, :1])
    with pytest.raises(ObservationError, match=r"parameters \(\d+, 1\), expected \[\*B, 3\]"):
        model(state, target, torch.zeros(len(target), 1))
    with pytest.raises(ObservationError, match=r"parameters \(\d+, 3\), expected \[\*B, 0\]"):
        DynamicsModel(G1)(state, target, torch.zeros(len(target), 3))
    with pytest.raises(ObservationError, match=r"joint_pos of the state \(\d+, 28\), expected"):
        model(state._replace(joint_pos=state.joint_pos[:, 1:]), target)
