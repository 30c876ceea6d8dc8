import copy

import pytest
import torch
from tensordict import TensorDict
from torchrl.envs import SerialEnv, StepCounter, Transform, TransformedEnv
from torchrl.envs.utils import check_env_specs

from plat.envs import (
    COMMAND_KEYS,
    ROBOT_KEYS,
    DistillationTaskConfig,
    KeyframeTaskConfig,
    ResetNoise,
    TrackingTaskConfig,
    goal_keys,
    make_keyframe_env,
    make_tracking_env,
    privileged_keys,
)
from plat.envs.transforms import (
    FailureWeightedStarts,
    NoiseLevels,
    ObservationTransform,
    RandomizationRanges,
    Reward,
    pop_statistics,
)
from plat.errors import ConfigError, MotionError, PlatError
from plat.tasks import DenseTracking, SimulatedTask, TimedKeyframes, TimedKeyframesConfig

EVERYTHING = {"noise": NoiseLevels(), "randomization": RandomizationRanges()}


@pytest.mark.parametrize(
    ("make", "config"), [(make_tracking_env, TrackingTaskConfig), (make_keyframe_env, KeyframeTaskConfig)]
)
@pytest.mark.parametrize("settings", [{}, EVERYTHING], ids=["plain", "everything"])
def test_specs(library, make, config, settings):
    check_env_specs(make(library, 3, config(**settings)))


def _chains(library, count):
    config = TimedKeyframesConfig(chains=6, partial=0.5)
    return SimulatedTask(TimedKeyframes(library, config), count, randomization=RandomizationRanges())


@pytest.mark.parametrize(
    "make",
    [
        lambda library, count: make_tracking_env(library, count, TrackingTaskConfig(**EVERYTHING)),
        lambda library, count: make_keyframe_env(library, count, KeyframeTaskConfig(**EVERYTHING)),
        lambda library, count: SimulatedTask(DenseTracking(library), count),
        _chains,
    ],
    ids=["tracking", "keyframes", "dense", "chains"],
)
def test_the_same_episodes_follow_a_seed_whatever_failed_before(library, make):
    env = make(library, 8)

    def rollout(seed, steps):
        env.set_seed(seed)
        act = lambda td: td.set("action", 5 * torch.randn(8, 29))  # noqa: E731
        return env.rollout(steps, act, break_when_any_done=False)

    first = rollout(3, 60)
    assert first["next", "terminated"].any()
    rollout(4, 120)
    again = rollout(3, 60)
    for key, values in first.items(include_nested=True, leaves_only=True):
        torch.testing.assert_close(again[key], values, rtol=0, atol=0, equal_nan=True, msg=str(key))


def test_groups_that_networks_read(library):
    tracking = set(make_tracking_env(library, 2).observation_spec.keys(True, True))
    assert tracking >= {*ROBOT_KEYS, *goal_keys(), *privileged_keys()}
    keyframe = set(make_keyframe_env(library, 2).observation_spec.keys(True, True))
    assert keyframe >= {*ROBOT_KEYS, *goal_keys(), *goal_keys("dense_goal"), *COMMAND_KEYS, *privileged_keys()}


def test_rollouts_hold_no_working_entries(library):
    entries = set(make_keyframe_env(library, 2).observation_spec.keys(True, True))
    assert not any(key[0] in ("reference", "metrics") for key in entries)
    assert {key for key in entries if key[0] == "state"} == {("state", "root_pos_w"), ("state", "root_quat_w")}


def test_partial_resets_agree_with_whole_ones(library):
    # what transforms compute for a few rows after a mask reset is what they compute for all rows
    env = make_keyframe_env(library, 8, KeyframeTaskConfig(reset_noise=ResetNoise(*[0.0] * 9)))
    state = env.reset()
    mask = torch.zeros(8, 1, dtype=torch.bool)
    mask[[1, 5]] = True
    after = env.reset(state.clone().update({"_reset": mask}))
    keep = ~mask[:, 0]
    for key in state.keys(True, True):
        assert torch.equal(after[key][keep], state[key][keep]), key
    last = [transform for transform in env.transform if isinstance(transform, ObservationTransform)][-1]
    whole = last.compute(last._reset(state.empty(), env.base_env._observe()))
    for key, value in whole.items():
        torch.testing.assert_close(after[key][~keep], value[~keep])


@pytest.mark.parametrize(
    "config",
    [DistillationTaskConfig(), KeyframeTaskConfig(dense_weight=0, sparse_weight=0, regularization_weight=0)],
    ids=["none", "weightless"],
)
def test_rewards_without_weight_are_left_out(library, config):
    env = make_keyframe_env(library, 2, config)
    rollout = env.rollout(3)
    assert (rollout["next", "reward"] == 0).all()
    assert not any(name.startswith("reward/") for name in pop_statistics(env))


@pytest.mark.parametrize(
    "make", [make_tracking_env, make_keyframe_env, lambda *args: SimulatedTask(DenseTracking(args[0]), 2)]
)
def test_entries_are_float32_and_carry_no_gradient(library, make):
    env = make(library, 2)
    weight = torch.ones(29, dtype=torch.float64, requires_grad=True)
    rollout = env.rollout(4, lambda td: td.set("action", weight * td["robot", "last_action"].double() + 0.1 * weight))
    for entries in (rollout["robot"], rollout["next", "robot"], rollout["next"].select("reward")):
        for key, value in entries.items():
            assert value.dtype == torch.float32, key
            assert not value.requires_grad, key


def test_a_reward_in_float64_is_added_in_float32(library):
    reward = Reward("double", 1.0, lambda before, after: torch.ones(2, dtype=torch.float64))
    assert make_tracking_env(library, 2, rewards=(reward,)).rollout(2)["next", "reward"].dtype == torch.float32


def test_statistics_are_collected_and_cleared(library):
    env = make_tracking_env(library, 4)
    env.rollout(3, break_when_any_done=False)
    statistics = pop_statistics(env)
    assert {"terminated", "error/keypoint_aligned", "reward/anchor_pos", "reward/action_rate"} <= set(statistics)
    assert pop_statistics(env) == {}


def test_a_tracker_may_be_shown_several_frames(library):
    env = make_tracking_env(library, 3, goals={"goal": 1, "goal_6": 6})
    state = env.reset()
    frame = state["motion", "frame"]
    for group, ahead in (("goal", 1), ("goal_6", 6)):
        wanted = library.poses((frame + ahead).minimum(library.last_frame[frame]))
        assert torch.equal(state[group, "joint_pos"], wanted["joint_pos"])
        assert state[group, "keypoint_pos_b"].shape == (3, 42)


ALIVE = Reward("alive", 1.0, lambda before, after: torch.ones(after.batch_size))


@pytest.mark.parametrize(
    ("make", "arguments", "message"),
    [
        (
            make_keyframe_env,
            {"config": TrackingTaskConfig()},
            "config is Tracking.*, expected a KeyframeTaskConfig or a Distill",
        ),
        (make_tracking_env, {"config": KeyframeTaskConfig()}, "config is KeyframeTask.*, expected a Tracking"),
        (make_keyframe_env, {"timing": 0.02}, "timing is 0.02, expected a Timing or None"),
        (make_tracking_env, {"goals": "goal"}, "goals is 'goal', expected a Mapping"),
        (make_keyframe_env, {"dense_goals": {"past": -1}}, "goal 'past': frames ahead is -1, expected a whole number"),
        (make_tracking_env, {"goals": {"goal": 1.5}}, "goal 'goal': frames ahead is 1.5, expected a whole number"),
        (make_tracking_env, {"rewards": [len]}, "rewards hold <built-in function len>, expected each to be a Reward"),
        (make_tracking_env, {"rewards": ALIVE}, "rewards is a single Reward, expected several in a tuple"),
    ],
)
def test_an_argument_of_another_kind_is_named(library, make, arguments, message):
    with pytest.raises(PlatError, match=f"^{message}"):
        make(library, 2, **arguments)


def test_transforms_are_several_transforms(library):
    with pytest.raises(PlatError, match="transforms is a single FailureWeightedStarts, expected several in a tuple"):
        make_tracking_env(library, 2, transforms=FailureWeightedStarts(library, 2))
    with pytest.raises(PlatError, match="transforms hold 1, expected each to be a Transform of TorchRL"):
        make_keyframe_env(library, 2, transforms=(1,))


def test_motions_have_to_be_loaded():
    with pytest.raises(PlatError, match="library is 'clips.npz', expected a MotionLibrary"):
        make_keyframe_env("clips.npz", 2)


class RootSpeed(ObservationTransform):
    """An observation of somebody else's."""

    def __init__(self):
        super().__init__([("robot", "root_lin_vel_b")], {("own", "speed"): (1,)})

    def compute(self, tensordict):
        return {("own", "speed"): tensordict["robot", "root_lin_vel_b"].norm(dim=-1, keepdim=True)}


class Sink(Transform):
    """An ending of somebody else's."""

    def _step(self, tensordict, next_tensordict):
        next_tensordict["terminated"] = next_tensordict["terminated"] | True
        next_tensordict["done"] = next_tensordict["terminated"]
        return next_tensordict


@pytest.mark.parametrize("make", [make_tracking_env, make_keyframe_env])
def test_transforms_of_ones_own(library, make):
    env = make(library, 3, transforms=[RootSpeed(), Sink()])
    rollout = env.rollout(2, break_when_any_done=False)
    speed = rollout["robot", "root_lin_vel_b"].norm(dim=-1, keepdim=True)
    torch.testing.assert_close(rollout["own", "speed"], speed)
    assert rollout["next", "terminated"].all()
    starts = next(transform for transform in env.transform if isinstance(transform, FailureWeightedStarts))
    assert starts.failures.sum() > 0  # it hears of failures that end an episode


@pytest.mark.parametrize("make", [make_tracking_env, make_keyframe_env])
@pytest.mark.parametrize("around", [lambda env: env, lambda env: TransformedEnv(env, StepCounter())])
def test_episodes_start_where_a_reset_says(library, make, around):
    env, start = around(make(library, 3)), torch.tensor([5, 6, 7])
    state = env.reset(start=start)
    assert state["motion", "frame"].tolist() == [5, 6, 7]
    torch.testing.assert_close(state["estimate", "root_pos_w"], library.qpos(start)[:, :3], atol=0.2, rtol=0)
    env.rollout(2, auto_reset=False, tensordict=state)
    mask = torch.tensor([[False], [True], [False]])
    before = TensorDict({**dict.fromkeys(("done", "terminated", "truncated"), mask), "_reset": mask}, [3])
    assert env.reset(before, start=start + 20)["motion", "frame"][1] == 26
    for wrong, found in ((torch.tensor([1, 2]), r"int64 of shape \(2,\)"), (start / 2, r"float32 of shape \(3,\)")):
        with pytest.raises(MotionError, match=f"environment reset: start is {found}, expected a whole number for"):
            env.reset(start=wrong)
    with pytest.raises(MotionError, match="motion.start is -1 to 1, expected frames"):
        env.reset(start=start.sub(6))


@pytest.mark.parametrize("make", [make_tracking_env, make_keyframe_env])
def test_a_state_of_robots_is_a_snapshot(library, make):
    ranges = RandomizationRanges(encoder_bias=0.1, gyro_bias=0.1, control_delay=1.0)
    config = {make_tracking_env: TrackingTaskConfig, make_keyframe_env: KeyframeTaskConfig}[make](randomization=ranges)
    env = make(library, 4, config)
    robots = env.base_env
    reached = env.rollout(3, break_when_any_done=False)[:, -1]["next"].set("action", torch.randn(4, 29))
    state = {"robots": robots.state_dict(), "transforms": env.state_dict()}
    kept = copy.deepcopy(state)
    random = torch.get_rng_state()
    wanted = env.step(reached.clone())["next"]
    fallen = torch.full((4, 29), 1e9)  # every robot is reset, and drawn anew
    for _ in range(3):
        env.step_and_maybe_reset(reached.clone().set("action", fallen))
    for of in ("transforms", "robots"):
        for name, value in flat(state[of]):
            assert torch.equal(value, dict(flat(kept[of]))[name]), name
    robots.load_state_dict(state["robots"])
    env.load_state_dict(state["transforms"])
    torch.set_rng_state(random)
    found = env.step(reached.clone())["next"]
    for key, value in wanted.items(True, True):
        assert torch.equal(found[key], value), key


def flat(state, name=""):
    """Tensors of nested dictionaries by their names, but failures, whose place in memory a module's state shares."""
    for key, value in state.items():
        if isinstance(value, dict):
            yield from flat(value, f"{name}.{key}")
        elif isinstance(value, torch.Tensor) and not key.endswith("failures"):
            yield f"{name}.{key}", value


@pytest.mark.parametrize("make", [make_tracking_env, make_keyframe_env])
def test_environments_side_by_side(library, make):
    env = SerialEnv(2, lambda: make(library, 3))
    rollout = env.rollout(4, break_when_any_done=False)
    assert rollout.shape == (2, 3, 4)
    assert rollout.get("reference", None) is None
    env.close()


@pytest.mark.parametrize("make", [make_keyframe_env, _chains])
def test_simulations_stay_where_they_are(library, make):
    env = make(library, 2)
    assert env.to("cpu") is env
    for device in ("cuda:7", "meta"):
        with pytest.raises(ConfigError, match="device|cannot be moved"):
            env.to(device)
    assert env.device == torch.device("cpu")
    assert env.rollout(2)["action"].device == torch.device("cpu")
