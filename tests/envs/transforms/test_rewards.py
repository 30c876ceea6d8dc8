import pytest
import torch
from tensordict import TensorDict

from plat.envs import KeyframeTaskConfig, make_keyframe_env
from plat.envs.transforms import KeyframeTermination, Reward, RewardGroup, Rewards, pop_statistics
from plat.errors import PlatError, TaskError
from plat.robots import G1


def step() -> tuple[TensorDict, TensorDict]:
    before = TensorDict({"action": torch.tensor([[1.0], [2.0]])}, [2])
    return before, TensorDict({"reward": torch.full((2, 1), 0.5)}, [2])


def action(before: TensorDict, after: TensorDict) -> torch.Tensor:
    return before["action"][:, 0]


def paid(*rewards: Reward | RewardGroup) -> list[float]:
    return Rewards(rewards, dt=0.1)._step(*step())["reward"][:, 0].tolist()


def test_terms_are_weighted_and_added_to_what_was_paid_before():
    assert paid(Reward("a", 2.0, action), Reward("b", -1.0, action)) == pytest.approx([0.5 + 0.1, 0.5 + 0.2])


def test_a_group_has_a_factor_and_a_floor():
    terms = (Reward("a", -1.0, action), Reward("b", -2.0, action))
    assert paid(RewardGroup(0.5, terms)) == pytest.approx([0.5 - 0.15, 0.5 - 0.3])
    group = RewardGroup(0.5, terms, floor=-4.0)
    assert paid(group) == pytest.approx([0.5 - 0.15, 0.5 - 0.2])
    second = {name: float(value[1]) for name, value in group.terms(*step()).items()}
    assert second == pytest.approx({"a": -4 / 3, "b": -8 / 3})


def test_a_floor_is_that_of_penalties():
    idle = Reward("idle", -1.0, lambda before, after: torch.zeros(after.batch_size))
    assert paid(RewardGroup(1.0, (idle,), floor=0.0)) == [0.5, 0.5]
    assert paid(RewardGroup(1.0, (Reward("a", -1.0, action),), floor=0.0)) == [0.5, 0.5]
    with pytest.raises(PlatError, match="reward group: floor is 1.0, expected a number of at most 0"):
        RewardGroup(1.0, (idle,), floor=1.0)


def test_what_has_no_weight_is_not_computed():
    def never(before, after):
        raise AssertionError

    assert paid(Reward("a", 0.0, never), RewardGroup(0.0, (Reward("b", 1.0, never),))) == [0.5, 0.5]


def test_names_are_of_one_term():
    with pytest.raises(TaskError, match="two rewards are called 'a'"):
        Rewards([Reward("a", 1.0, action), RewardGroup(1.0, (Reward("a", 1.0, action),))], 0.1)


def test_a_term_that_cannot_be_computed_is_named():
    with pytest.raises(TaskError, match="reward 'a' reads an entry that is not there: .*speed"):
        paid(Reward("a", 1.0, lambda before, after: after["speed"]))
    with pytest.raises(TaskError, match=r"reward 'a' has shape \(2, 1\), expected \(2,\)"):
        paid(Reward("a", 1.0, lambda before, after: before["action"]))


def test_a_term_that_is_no_tensor_is_named():
    for value, kind in ((1.0, "float"), (None, "NoneType")):
        with pytest.raises(TaskError, match=rf"reward 'a' is a {kind}, expected a tensor of shape \(2,\)"):
            paid(Reward("a", 1.0, lambda before, after, value=value: value))


def test_a_reward_of_ones_own(library):
    own = Reward("alive", 3.0, lambda before, after: torch.ones(after.batch_size))
    env = make_keyframe_env(library, 2, rewards=(own,))
    rollout = env.rollout(3)
    torch.testing.assert_close(rollout["next", "reward"], torch.full((2, rollout.shape[1], 1), 3.0 * library.dt))
    assert pop_statistics(env)["reward/alive"] == 3.0


def test_rewards_see_the_command_that_the_step_belonged_to(library):
    seen = []

    def look(before, after):
        seen.append((before["command", "steps_left"] - after["command", "steps_left"]).clone())
        return torch.zeros(after.batch_size)

    make_keyframe_env(library, 2, rewards=(Reward("look", 1.0, look),)).rollout(20, break_when_any_done=False)
    assert all((change == 1).all() for change in seen)


DEFAULTS = KeyframeTaskConfig().rewards(G1)


@pytest.mark.parametrize(
    ("position", "transform", "message"),
    [
        (
            0,
            Rewards(DEFAULTS, 0.02),
            r"Rewards reads \('reference', 'joint_pos'\), .* put ReferenceMotion",
        ),
        (1, Rewards(DEFAULTS, 0.02), r"Rewards reads \('command', 'in_window'\), .* put KeyframeClock before it"),
        (-1, Rewards(DEFAULTS, 0.02), r"Rewards judges a step, .* put it before KeyframeCommand"),
        (0, KeyframeTermination(G1), r"KeyframeTermination reads \('reference', .*ReferenceMotion before it"),
        (-1, KeyframeTermination(G1), r"KeyframeTermination judges a step"),
    ],
)
def test_a_transform_in_the_wrong_place_says_so(library, position, transform, message):
    env = make_keyframe_env(library, 2, rewards=())
    index = position if position >= 0 else len(env.transform) - 2  # the last two take the working groups away
    with pytest.raises(TaskError, match=message):
        env.insert_transform(index, transform).rollout(1)


def test_a_term_without_a_function_is_named():
    with pytest.raises(TaskError, match="reward 'still': expected a function of the entries before and after a step"):
        Reward("still", 1.0, 3.0)
