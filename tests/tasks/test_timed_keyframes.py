import pytest
import torch
from tensordict import TensorDict

from plat.collectors import PrivilegedGoals
from plat.envs import GeneralizedState
from plat.errors import PlatError
from plat.spec.timing import Timing
from plat.tasks import TimedKeyframes, TimedKeyframesConfig
from tests.tasks.keyframe_tasks import bent_task, kicked, line_of, partial_task, play, whole_task


@pytest.fixture(scope="module")
def task(library):
    return whole_task(library)


def test_a_chain_is_commanded_in_order_and_then_held(task):
    chains = task.chains
    number = chains.family.index("arms")
    _, memory = task.authored(torch.tensor([number]))
    first, frames = int(chains.first_row[number]), int(task.chain_rows.first_row[0])
    rows, arrivals = [int(memory["goal"]) - frames], []
    for age, later in enumerate(play(task, memory, int(chains.duration[number])), start=1):
        if (row := int(later["goal"]) - frames) != rows[-1]:
            rows.append(row)
            arrivals.append(age)
    assert rows == list(range(first + 1, first + 6))
    # a keyframe is commanded when the one before it has had its time
    assert arrivals == chains.steps[first + 1 : first + 5].cumsum(0).tolist()
    assert task.finished(later).all()


def test_whoever_is_sent_too_far_too_often_may_be_left_behind(task):
    chains = {name: task.chains.family.index(name) for name in ("far", "steps")}
    for name, behind in (("far", False), ("steps", True)):
        _, memory = task.authored(torch.tensor([chains[name]]))
        state = line_of(task, memory)
        away = state._replace(root_pos_w=state.root_pos_w + torch.tensor([3.0, 0.0, 0.0]))
        assert bool(task.failed(away, memory)) == behind


def test_a_keyframe_is_missed_with_a_foot_too_high(task):
    state, arrival = kicked(task, by=1.2)
    underway = arrival.copy().set("steps_left", torch.tensor([1]))
    assert task.missed(state, arrival).item()
    assert not task.missed(state, underway).item()
    assert not task.missed(task.table.state(arrival["goal"]), arrival).item()
    assert not task.missed(state, arrival.copy().set("authored", torch.tensor([True]))).item()


@pytest.mark.parametrize("partial", [0.0, 0.5])
def test_it_starts_in_float64(library, partial):
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6, partial=partial)).double()
    state, memory = task.start(8)
    for _ in range(3):
        memory = task.advance(memory, torch.zeros(8, 29, dtype=torch.float64))
        assert task.cost(state, memory).dtype == torch.float64
        memory = task.renew(memory, state)
        assert {value.dtype for value in memory.values() if value.is_floating_point()} == {torch.float64}


def test_authored_starts_are_at_the_origin(task):
    state, memory = task.authored(torch.arange(12))
    assert memory["authored"].all()
    assert float(state.root_pos_w[:, :2].abs().max()) == 0
    assert float(state.root_quat_w[:, 3].abs().max()) < 0.3  # no heading; what is left is roll times pitch
    assert (state.root_pos_w[:, 2] > 0.4).all()


def test_failures_are_started_from_again(task):
    _, memory = task.authored(torch.full((400,), 3))
    before = float(task.chain_starts.failures[3])
    task.record_failures(memory)
    assert float(task.chain_starts.failures[3]) > before
    assert (task.chain_starts.draw(500) == 3).float().mean() > 1.5 / 12


def test_both_kinds_start(task):
    state, memory = task.start(200)
    assert 0.3 < float(memory["authored"].float().mean()) < 0.7
    assert isinstance(state, GeneralizedState)
    assert not task.failed(state, memory).any()
    assert not task.lost(state, memory).any()


def test_the_privileged_goals_are_those_of_dagger(task, library):
    """As the transform of stage 2's buffer gathers them."""
    state, memory = task.along(torch.tensor([3, 40, 90]))
    ours = task.privileged(state, memory)
    steps = TensorDict(
        {
            "command": {"steps_left": memory["steps_left"][:, None]},
            "motion": {"frame": memory["frame"]},
            "estimate": {"root_pos_w": state.root_pos_w, "root_quat_w": state.root_quat_w},
        },
        [3],
    )
    theirs = PrivilegedGoals(library, task.config.stride)(steps)["privileged_goal"]
    assert ours["length"].equal(theirs["length"])
    torch.testing.assert_close(ours["frames"], theirs["frames"], atol=1e-5, rtol=0)


def test_an_authored_keyframe_tells_a_posterior_nothing_more(task):
    state, memory = task.authored(torch.arange(8))
    privileged = task.privileged(state, memory)
    assert (privileged["length"] == 1).all()
    goal = task.observe(state, memory)["goal"]
    torch.testing.assert_close(privileged["frames"][:, 0], torch.cat(list(goal.values()), -1))


def test_commands_may_be_longer_than_a_second_at_least(library):
    config = TimedKeyframesConfig(chains=6, shortest=60, distant=0.5)
    task = TimedKeyframes(library, config, timing=Timing(max_steps=150))
    steps = task._draw_steps(torch.zeros(400, dtype=torch.int64))
    assert (steps == 60).float().mean() > 0.4
    assert (int(steps.min()), int(steps.max())) == (60, 150)


@pytest.mark.parametrize("longest", [10, 20])
def test_tau_is_at_most_1(library, longest):
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=12), timing=Timing(max_steps=longest))
    assert float(task.observe(*task.start(100))["command", "horizon"].max()) == 1.0


def test_motions_have_the_control_step_of_the_timing(library):
    with pytest.raises(PlatError, match=r"motion library of .* control step of 0.02 s, expected the policy's 0.01 s"):
        TimedKeyframes(library, TimedKeyframesConfig(chains=6), timing=Timing(control_dt=0.01))


@pytest.fixture(scope="module")
def bent(library):
    return bent_task(library)


def test_a_bent_line_passes_the_pose_midway(bent):
    task, memory, middle = bent
    for steps_left, row in ((30, memory["before"]), (0, memory["goal"])):
        line = line_of(task, memory.copy().set("steps_left", torch.tensor([steps_left])))
        assert torch.allclose(line.joint_pos, task.table.state(row).joint_pos, atol=1e-6)
    half = memory.copy().set("steps_left", torch.tensor([15]))
    assert torch.allclose(line_of(task, half).joint_pos[0], middle[7:], atol=1e-6)
    quarter = line_of(task, memory.copy().set("steps_left", torch.tensor([24]))).joint_pos[0]
    assert torch.allclose(quarter, task.table.state(memory["before"]).joint_pos[0].lerp(middle[7:], 0.4), atol=1e-5)


def test_a_pose_that_is_held_is_not_passed_by_midway(bent):
    task, memory, _ = bent
    held = memory.copy().set("before", memory["goal"]).set("steps_left", torch.tensor([15]))
    assert torch.allclose(line_of(task, held).joint_pos, task.table.state(memory["goal"]).joint_pos)


@pytest.mark.parametrize(
    ("family", "moved", "missed"),
    [
        ("steps", {"root_pos_w": (0.25, 0.0, 0.0)}, True),
        ("steps", {"root_pos_w": (0.15, 0.0, 0.0)}, False),
        ("arms", {"joint_pos": 0.25}, True),
        ("arms", {"joint_pos": 0.15}, False),
        ("reach", {"root_pos_w": (0.0, 0.0, 0.07)}, True),  # hands within 5 cm
        ("reach", {"root_pos_w": (0.0, 0.0, 0.03)}, False),
        ("far", {"root_pos_w": (0.5, 0.0, 0.0)}, False),  # it could not be there
    ],
)
def test_authored_keyframes_are_missed_by_the_thresholds_of_evaluation(library, family, moved, missed):
    config = TimedKeyframesConfig(chains=2, families=(family,), partial=float(family == "reach"))
    task = TimedKeyframes(library, config, reset_noise=None)
    _, memory = task.authored(torch.tensor([0]))
    there = task.table.state(memory["goal"])
    state = there._replace(**{name: getattr(there, name) + torch.tensor(by) for name, by in moved.items()})
    arrival = memory.copy().set("steps_left", torch.tensor([0]))
    assert task.missed(state, arrival).item() == missed
    assert not task.missed(there, arrival).item()
    assert not task.missed(state, memory).item()
    assert not task.missed(state, arrival.copy().set("before", memory["goal"])).item()


@pytest.fixture(scope="module")
def distant(library):
    return partial_task(library)


def test_commands_along_motions_are_usual_or_distant(distant):
    frame = torch.zeros(4000, dtype=torch.int64)
    steps = distant._draw_steps(frame)
    assert steps.min() >= 1
    assert steps.max() <= 150
    beyond = (steps > 50).float().mean()
    # a quarter of all lengths, of which two thirds are beyond a second
    assert 0.12 < beyond < 0.21
