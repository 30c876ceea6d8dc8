from itertools import islice, pairwise

import pytest
import torch
from tensordict.nn import TensorDictModule
from torchrl.envs.utils import ExplorationType, exploration_type

from plat.envs import make_keyframe_env
from plat.envs.transforms import HORIZONS, CommandSchedule
from plat.evaluation import ReferenceView, make_evaluation_env, policy_steps
from plat.evaluation.records import CommandRecorder
from plat.motions import MotionLibrary
from tests.conftest import standing_clip
from tests.evaluation.puppet import still


@pytest.fixture(scope="module")
def clips() -> MotionLibrary:
    """60 and 100 control steps."""
    return MotionLibrary.from_clips([standing_clip("a", frames=37), standing_clip("b", frames=61)])


def test_every_command_is_issued_once_and_robots_without_work_are_not_active(clips: MotionLibrary) -> None:
    schedule = CommandSchedule(clips, HORIZONS["long"], seed=1)
    task = make_evaluation_env(clips, schedule, 2)
    seen: list[int] = []
    active = []
    for step in task.steps(still):
        first = step["command", "steps_left"][:, 0] == (
            schedule.target_frame[step["motion", "frame"]] - step["motion", "frame"]
        )
        assert first[task.active].all()
        seen += schedule.command_of_frame[step["motion", "frame"][task.active]].tolist()
        active.append(int(task.active.sum()))
    task.close()
    assert set(seen) == set(range(schedule.num_commands))
    assert active[0] == 2
    assert active[-1] == 1  # the longer clip goes on alone


def test_a_step_shows_the_end_of_an_episode_and_the_next_one_its_new_beginning(clips: MotionLibrary) -> None:
    env = make_keyframe_env(clips, num_envs=3)
    steps = list(islice(policy_steps(still, env), 100))
    ends = torch.stack([step["next", "done"][:, 0] for step in steps])
    assert ends.any()
    for now, after in pairwise(steps):
        goes_on = ~now["next", "done"][:, 0]
        assert torch.equal(now["next", "motion", "frame"][goes_on], after["motion", "frame"][goes_on])
        assert not after["done"].any()


def test_the_caller_stays_in_its_own_mode(clips: MotionLibrary) -> None:
    weight = torch.nn.Linear(29, 29)
    modes = []

    def policy(tensordict):
        modes.append((exploration_type(), torch.is_grad_enabled()))
        return TensorDictModule(weight, [("robot", "joint_pos")], ["action"])(tensordict)

    before = exploration_type()
    for step in islice(policy_steps(policy, make_keyframe_env(clips, num_envs=1)), 2):
        assert exploration_type() == before
        assert torch.is_grad_enabled()
        assert not step["action"].requires_grad
    assert modes == [(ExplorationType.DETERMINISTIC, False)] * 2


@pytest.mark.parametrize("dense", [False, True])
def test_what_a_policy_is_shown(clips: MotionLibrary, dense: bool) -> None:
    view = ReferenceView(dense, {"goal": 1, "goal_6": 6})
    task = make_evaluation_env(clips, CommandSchedule(clips, HORIZONS["long"], 0), 1, view)
    groups = set(next(task.steps(still)).keys())
    assert ("goal_6" in groups) == ("keyframe" in groups) == dense
    assert "goal" in groups


def test_jerk_is_counted_where_a_robot_that_falls_often_has_one(clips: MotionLibrary) -> None:
    schedule = CommandSchedule(clips, HORIZONS["mixed"], seed=1)
    task, recorder = make_evaluation_env(clips, schedule, 2), CommandRecorder(clips, schedule)
    generator = torch.Generator().manual_seed(0)
    found = torch.zeros(schedule.num_commands, dtype=torch.float64)

    def flailing(tensordict):
        return tensordict.set("action", 20 * torch.randn(2, 29, generator=generator))

    for step in task.steps(flailing):
        recorder.add(step["motion", "frame"], task.active, step["next"])
        rows = schedule.command_of_frame[step["motion", "frame"][task.active]]
        found.index_add_(0, rows, (step["next", "metrics", "joint_jerk"][task.active, 0] > 0).double())
    task.close()
    records = recorder.records()
    assert records.failed.sum() > 3
    assert records.jerk_steps.tolist() == found.tolist()
    assert found.sum() < records.steps.sum()
