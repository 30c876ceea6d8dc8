import pytest
import torch
from tensordict import TensorDictBase

from plat.envs.transforms import CommandSchedule, Horizon, RandomizationRanges
from plat.envs.transforms.settings import ROBOT_RANGES
from plat.evaluation import (
    ClipRecords,
    CommandRecords,
    Disturbance,
    EvaluationSetting,
    evaluate,
    evaluate_clips,
    make_evaluation_env,
)
from plat.motions import MotionLibrary
from tests.conftest import standing_clip
from tests.evaluation.puppet import still

RANDOMIZED = {"randomization": ROBOT_RANGES}
DISTURBED = {"disturbance": Disturbance(motors=0.3, push=1.0, noise=1.0)}


@pytest.fixture(scope="module")
def clips() -> MotionLibrary:
    """150, 125 and 100 control steps."""
    return MotionLibrary.from_clips(
        [standing_clip(name, frames=frames) for name, frames in (("a", 91), ("b", 76), ("c", 61))]
    )


def unsteady(tensordict: TensorDictBase) -> TensorDictBase:
    """A policy that fails every command of 12 steps or more, by an absurd action, and heeds what it measures."""
    action = 0.1 * tensordict["robot", "joint_vel"]
    return tensordict.set("action", torch.where(tensordict["command", "steps_left"] == 12, 1e6, action))


def met(clips: MotionLibrary, policy, **conditions) -> dict[int, list[tuple]]:
    """What the robots of each clip are like at every step of it, and the pushes that they get before it."""
    setting = EvaluationSetting(num_threads=1, **conditions)
    task = make_evaluation_env(clips, CommandSchedule(clips, Horizon(5, 20), 0), 2, setting=setting)
    base, pushes = task.env.base_env, dict[int, torch.Tensor]()
    base.physics.push = lambda ids, velocities: pushes.update(zip(ids.tolist(), velocities, strict=True))
    found: dict[int, list[tuple]] = {clip: [] for clip in range(clips.num_clips)}
    failures = 0
    for step in task.steps(policy):
        gains = base.physics.model_field("actuator_gainprm")[:, :, 0]
        for row in task.active.nonzero()[:, 0].tolist():
            frame = step["motion", "frame"][row]
            robot = (*gains[row].tolist(), *base.encoder_bias[row].tolist(), int(base.delay[row]))
            found[int(clips.clip_of(frame))].append((int(frame), robot, pushes.get(row)))
        pushes.clear()
        failures += int(step["next", "terminated"][task.active].sum())
    task.close()
    assert policy is still or failures > 5
    return found


@pytest.mark.parametrize("conditions", [RANDOMIZED, DISTURBED], ids=["randomized", "disturbed"])
def test_a_clip_has_one_robot_however_often_it_fails(clips, conditions):
    """Each failure changed the robot for another: hard ones left, easy ones stayed."""
    often, seldom = met(clips, unsteady, **conditions), met(clips, still, **conditions)
    robots = [{robot for _, robot, _ in steps} for steps in often.values()]
    assert [len(of_clip) for of_clip in robots] == [1, 1, 1]
    assert len(set.union(*robots)) == 3
    # another policy meets the same ones
    assert robots == [{robot for _, robot, _ in steps} for steps in seldom.values()]


@pytest.mark.parametrize(
    "conditions",
    [{"randomization": RandomizationRanges(push_interval=(0.3, 0.6))}, {"disturbance": Disturbance(push=1.0)}],
    ids=["randomized", "disturbed"],
)
def test_a_failure_puts_no_push_off(clips, conditions):
    def pushes(policy) -> dict[int, list[float] | None]:
        steps = [step for of_clip in met(clips, policy, **conditions).values() for step in of_clip]
        return {frame: None if push is None else push.tolist() for frame, _, push in steps}

    often, seldom = pushes(unsteady), pushes(still)
    both = often.keys() & seldom.keys()  # a failure skips frames
    assert len(often) < len(seldom)
    assert any(often[frame] for frame in both)
    assert [often[frame] for frame in both] == [seldom[frame] for frame in both]


def test_the_drift_of_a_state_estimate_outlives_a_failure(clips):
    """A failure took it away, so that a policy that fails often was shown the truer place."""
    setting = EvaluationSetting(num_threads=1, randomization=RandomizationRanges(heading_drift=0.1))
    task = make_evaluation_env(clips, CommandSchedule(clips, Horizon(10, 10), 0), 3, setting=setting)
    before = torch.zeros(3)
    for step in task.steps(unsteady):
        drift = task.env.base_env.drift[:, 3].abs()
        assert (drift > before)[task.active].all()
        before = torch.where(step["next", "truncated"][:, 0], 0.0, drift)
    task.close()


def same(one: CommandRecords | ClipRecords, other: CommandRecords | ClipRecords) -> None:
    for name, column in one.columns().items():
        torch.testing.assert_close(column, other.columns()[name], equal_nan=True, msg=name)


@pytest.mark.parametrize("conditions", [RANDOMIZED, DISTURBED], ids=["randomized", "disturbed"])
def test_what_is_drawn_depends_neither_on_the_number_of_robots_nor_on_other_clips(clips, conditions):
    whole = evaluate(unsteady, clips, Horizon(5, 20), **conditions)
    assert 0 < whole.failed.sum() < len(whole.failed)
    same(whole, evaluate(unsteady, clips, Horizon(5, 20), num_envs=1, **conditions))
    parts = [evaluate(unsteady, clips, Horizon(5, 20), clips=part, **conditions) for part in ([0], [1, 2])]
    same(whole, CommandRecords.joined(parts))
    other = evaluate(unsteady, clips, Horizon(5, 20), seed=1, **conditions)
    assert not torch.equal(whole.window["joint_error"][:3], other.window["joint_error"][:3])


@pytest.mark.parametrize("conditions", [RANDOMIZED, DISTURBED], ids=["randomized", "disturbed"])
def test_whole_clips_meet_the_same_in_other_batches(clips, conditions):
    torch.manual_seed(0)
    expected = torch.rand(1)
    torch.manual_seed(0)
    whole = evaluate_clips(still, clips, "humantracker", **conditions)
    assert torch.rand(1) == expected  # it drew from the caller's generator
    same(whole, evaluate_clips(still, clips, "humantracker", num_envs=1, **conditions))
    same(evaluate_clips(still, clips, "humantracker", clips=[2], **conditions), of_clip(whole, 2))


def of_clip(records: ClipRecords, clip: int) -> ClipRecords:
    rows = records.clip == clip
    return ClipRecords.from_columns({name: column[rows] for name, column in records.columns().items()}, records.rule)
