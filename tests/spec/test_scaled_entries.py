"""By the table of a user who scales what policies observe, what is computed of it is the same as without."""

from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from plat.baselines.tracker import Tracker
from plat.envs import GeneralizedState, make_keyframe_env
from plat.envs.transforms import Horizon, KeyframeMetrics
from plat.export.network import JointTargetNetwork
from plat.modules import (
    Expert,
    ExpertConfig,
    GoalLead,
    KeyframeLead,
    KeyframeReach,
    LatentPolicy,
    ReferenceOffset,
    RefinementConfig,
    ResidualLatentPolicy,
    WalkingReach,
)
from plat.objectives import motor_gradient
from plat.robots import G1
from plat.spec.observation import OBSERVATION, ObservationTable, entries_of, observing, student_keys
from tests.modules.policies.test_student import SMALL

SCALED = ObservationTable(
    {
        group: tuple(replace(entry, scale=(0.25, 4.0, 0.5)[number % 3]) for number, entry in enumerate(entries))
        for group, entries in OBSERVATION.groups.items()
    }
)


@pytest.fixture
def scaled():
    with observing(SCALED):
        yield


def as_scaled(entries: TensorDict) -> TensorDict:
    """The same quantities as the scaled table shows them."""
    keys = list(entries.keys(True, True))
    with observing(SCALED):
        shown = {key: entry.observed(entries[key]) for key, entry in zip(keys, entries_of(keys), strict=True)}
    return TensorDict(shown, entries.batch_size)


def of_a_keyframe(library, **settings) -> TensorDict:
    torch.manual_seed(0)
    env = make_keyframe_env(library, 4, horizon=Horizon(5, 5), **settings)
    return env.rollout(6, break_when_any_done=False)


@pytest.mark.parametrize(
    "make",
    [
        lambda: GoalLead(("goal", "dense_goal"), lead=0.1, gain=0.5, interval=0.02, limit=0.1),
        lambda: KeyframeLead(0.05, horizon=1.0),
        lambda: KeyframeLead(0.05, horizon=1.0, parts=True),
        lambda: KeyframeReach(WalkingReach(margin=0.0), horizon=1.0),
        lambda: KeyframeReach(WalkingReach(margin=0.0, speed=0.1), horizon=1.0, parts=True),
    ],
    ids=["frames", "lead", "lead of parts", "reach", "reach of parts"],
)
def test_a_keyframe_is_moved_by_as_many_meters(library, make):
    with torch.no_grad():
        rollout = of_a_keyframe(library)
        seen = rollout.select(*(key for key in make().in_keys)).reshape(-1)
        expected = as_scaled(make()(seen.clone()).select(*make().out_keys))
        with observing(SCALED):
            found = make()(as_scaled(seen)).select(*make().out_keys)
    for key in expected.keys(True, True):
        torch.testing.assert_close(found[key], expected[key])


def test_an_action_on_the_reference_is_the_same(library):
    keys = ("residual", ("goal", "joint_pos"), ("goal_2", "joint_pos"))
    seen = TensorDict({"residual": torch.randn(3, 29), "goal": {"joint_pos": torch.randn(3, 29)}}, [3])
    seen["goal_2", "joint_pos"] = torch.randn(3, 29)
    expected = ReferenceOffset(G1, keys, "loc", interval=0.02)(seen.clone())["loc"]
    with observing(SCALED):
        found = ReferenceOffset(G1, keys, "loc", interval=0.02)(as_scaled(seen))["loc"]
    torch.testing.assert_close(found, expected)


def test_the_motor_gradient_is_the_same(library):
    rollout = of_a_keyframe(library)
    expected = motor_gradient(rollout, G1, goal="dense_goal")
    shown = as_scaled(rollout.select(("robot", "joint_pos"), ("dense_goal", "joint_pos")))
    shown["next", "done"] = rollout["next", "done"]
    assert expected.any()
    with observing(SCALED):
        torch.testing.assert_close(motor_gradient(shown, G1, goal="dense_goal"), expected)


def test_rewards_metrics_and_states_are_the_same(library):
    plain = of_a_keyframe(library, transforms=[KeyframeMetrics(library)])
    with observing(SCALED):
        found = of_a_keyframe(library, transforms=[KeyframeMetrics(library)])
        states = GeneralizedState.from_entries(with_joints(found)).pack()
    torch.testing.assert_close(found["next", "reward"], plain["next", "reward"])
    torch.testing.assert_close(found["next", "metrics"].to_dict(), plain["next", "metrics"].to_dict())
    assert plain["next", "metrics", "action_change"].any()
    torch.testing.assert_close(states, GeneralizedState.from_entries(with_joints(plain)).pack())


def with_joints(rollout: TensorDict) -> TensorDict:
    """Entries with those of the state that a task leaves out."""
    rollout["state", "joint_pos"] = rollout["state", "joint_vel"] = torch.zeros(*rollout.shape, 29)
    return rollout


def test_a_released_tracker_is_given_quantities(library):
    class Still(Tracker):
        def __init__(self):
            torch.nn.Module.__init__(self)
            self.robot, self.seen = G1, []

        def targets(self, tensordict, joint_pos, starting):
            self.seen.append(torch.cat([joint_pos, tensordict["robot", "joint_vel"]], -1))
            return joint_pos

    tracker, rollout = Still(), of_a_keyframe(library)[:, 2].select("robot")
    rollout["is_init"] = torch.zeros(4, 1, dtype=torch.bool)
    expected = tracker.forward(rollout.clone())["action"]
    shown = as_scaled(rollout.select("robot"))
    shown["is_init"] = rollout["is_init"]
    with observing(SCALED):
        torch.testing.assert_close(tracker.forward(shown)["action"], expected)
    torch.testing.assert_close(*tracker.seen)


def test_an_exported_policy_moves_its_keyframe_as_the_policy_does(library, scaled):
    student = LatentPolicy(G1, replace(SMALL, reach=WalkingReach(margin=0.0, speed=0.1)))
    for config in (RefinementConfig(lead=0.1), RefinementConfig()):
        for base in (student, LatentPolicy(G1, SMALL)):
            policy = ResidualLatentPolicy(base, config).eval()
            seen = of_a_keyframe(library).reshape(-1)
            with torch.no_grad():
                action = policy.deployed()(seen.clone())["action"]
                target = JointTargetNetwork(policy)(torch.cat([seen[key] for key in student_keys()], -1))
            torch.testing.assert_close(target, G1.default_joint_pos + G1.action_scale * action, rtol=1e-4, atol=1e-5)


def test_an_expert_with_a_lead_acts_the_same(library):
    torch.manual_seed(0)
    config = ExpertConfig(hidden=(8,), action="reference_velocity", ahead=(1, 2), lead=0.1, catch_up=1.0)
    seen = of_a_keyframe(library).reshape(-1)
    seen["goal_2"] = seen["dense_goal"].clone()
    expert = Expert(G1, config)
    last = expert.network[-1]
    torch.nn.init.zeros_(last.weight)  # what it adds to its reference is the same then
    expected = expert.deployed(tuple(expert.goals))(seen.clone())["action"]
    keys = [key for key in seen.keys(True, True) if isinstance(key, tuple) and key[0] in ("robot", "goal", "goal_2")]
    with observing(SCALED):
        found = expert.deployed(tuple(expert.goals))(as_scaled(seen.select(*keys)))["action"]
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)
