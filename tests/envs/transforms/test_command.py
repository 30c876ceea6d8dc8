import pytest
import torch
from tensordict import TensorDict

from plat.envs import make_keyframe_env, robot_centric_goal
from plat.envs.transforms import (
    HORIZONS,
    PAPER_HORIZONS,
    CommandSchedule,
    Horizon,
    KeyframeClock,
    KeyframeCommand,
    horizon_named,
)
from plat.errors import MotionError, PlatError, TaskError
from plat.motions import MotionLibrary
from plat.spec.timing import Timing
from tests.conftest import standing_clip


def test_horizons_are_the_papers_and_a_distant_one():
    assert {name: (h.shortest, h.longest) for name, h in PAPER_HORIZONS.items()} == {
        "single": (1, 1),
        "short": (2, 10),
        "medium": (11, 25),
        "long": (26, 50),
        "mixed": (1, 50),
    }
    assert {**PAPER_HORIZONS, "distant": Horizon(51, 150)} == HORIZONS


@pytest.mark.parametrize("bounds", [(0, 5), (5, 4)])
def test_impossible_horizons(bounds):
    with pytest.raises(TaskError, match="expected 1 <= shortest <= longest"):
        Horizon(*bounds)


def test_horizons_by_name():
    assert horizon_named("long", Timing()) == Horizon(26, 50)
    assert horizon_named("all", Timing(max_steps=7)) == Horizon(1, 7)
    assert horizon_named("distant", Timing(max_steps=150)) == Horizon(51, 150)
    with pytest.raises(TaskError, match="horizon is 'far', expected one of: single, .* distant, all"):
        horizon_named("far", Timing())
    with pytest.raises(PlatError, match="horizon 'distant': 150 control steps, expected at most the policy's 50"):
        horizon_named("distant", Timing())
    with pytest.raises(TaskError, match="at most the policy's 25; 'all' is every length up to that"):
        horizon_named("mixed", Timing(max_steps=25))


def test_motions_and_commands_that_do_not_fit_the_timing(library):
    with pytest.raises(PlatError, match=r"clips: control step of 0.02 s, expected the policy's 0.01 s"):
        KeyframeCommand(library, Horizon(1, 5), timing=Timing(control_dt=0.01))
    with pytest.raises(PlatError, match="horizon of 1 to 51 steps: 51 control steps, expected at most the policy's 50"):
        KeyframeCommand(library, Horizon(1, 51))
    with pytest.raises(PlatError, match="51 control steps"):
        make_keyframe_env(library, 2, horizon=Horizon(1, 51))


def test_the_window_is_that_of_the_timing():
    clock, marks = KeyframeClock(window=5), []
    command = {"target_frame": torch.tensor([9]), "steps_left": torch.tensor([[7]])}
    state = TensorDict({"command": TensorDict(command, [1])}, [1])
    for _ in range(7):
        state = clock._step(state, TensorDict({}, [1]))
        marks.append(bool(state["command", "in_window"]))
    assert marks == [False, False, True, True, True, True, True]


@pytest.mark.parametrize("horizon", PAPER_HORIZONS.values(), ids=PAPER_HORIZONS)
def test_schedules_follow_their_horizon(library, horizon):
    schedule = CommandSchedule(library, horizon, seed=0)
    for clip in range(library.num_clips):
        frame = int(library.clip_start[clip])
        last = frame + int(library.clip_length[clip]) - 1
        while (target := int(schedule.target_frame[frame])) >= 0:
            steps = target - frame
            assert steps <= horizon.longest
            assert steps >= horizon.shortest
            assert (schedule.target_frame[frame:target] == target).all()
            assert len(schedule.command_of_frame[frame:target].unique()) == 1
            frame = target
        # what is left at the end is too short for a command
        assert last - frame < horizon.shortest


def test_schedules_depend_on_the_seed_only(library):
    first, second, other = (CommandSchedule(library, HORIZONS["mixed"], seed) for seed in (1, 1, 2))
    assert torch.equal(first.target_frame, second.target_frame)
    assert not torch.equal(first.target_frame, other.target_frame)


def test_last_command_ends_on_the_clips_last_frame():
    # 61 frames at 30 Hz are 101 at 50 Hz: 100 steps hold two commands of 50 and nothing else
    library = MotionLibrary.from_clips([standing_clip()])
    schedule = CommandSchedule(library, Horizon(50, 50), seed=0)
    assert schedule.num_commands == 2
    assert schedule.target_frame[[0, 49, 50, 99, 100]].tolist() == [50, 50, 100, 100, -1]
    # a third command of 40 does not fit into the 20 steps that two of them leave
    assert CommandSchedule(library, Horizon(40, 40), seed=0).target_frame[[79, 80]].tolist() == [80, -1]


def test_a_clip_shorter_than_the_horizon_is_named(library):
    short = MotionLibrary.from_clips([standing_clip(), standing_clip("blink", frames=13)])
    with pytest.raises(
        MotionError, match=r"motion 'blink': 20 control steps \(0.40 s\), shorter than .* 26 steps \(1 of 2"
    ):
        CommandSchedule(short, HORIZONS["long"], seed=0)
    with pytest.raises(MotionError, match="'blink'"):
        make_keyframe_env(short, 2, horizon=HORIZONS["long"])


def test_clock_counts_down_and_marks_the_window():
    clock = KeyframeClock()
    command = {"target_frame": torch.tensor([9]), "steps_left": torch.tensor([[5]])}
    state = TensorDict({"command": TensorDict(command, [1])}, [1])
    seen = []
    for _ in range(5):
        following = clock._step(state, TensorDict({"motion": {"frame": torch.zeros(1, dtype=torch.int64)}}, [1]))
        command = following["command"]
        seen.append((int(command["steps_left"]), bool(command["in_window"]), bool(command["arrived"])))
        state = following
    assert seen == [(4, False, False), (3, False, False), (2, True, False), (1, True, False), (0, True, True)]


def test_commands_are_kept_until_arrival_and_then_replaced(library):
    env = make_keyframe_env(library, 64, horizon=Horizon(3, 6))
    state = env.reset()
    for _ in range(20):
        before = state["command"].clone()
        state["action"] = torch.zeros(64, 29)
        stepped, state = env.step_and_maybe_reset(state)
        after, goes_on = stepped["next", "command"], ~stepped["next", "done"][:, 0]
        arrived = (before["steps_left"] == 1)[:, 0]
        kept = goes_on & ~arrived
        assert torch.equal(after["target_frame"][kept], before["target_frame"][kept])
        assert torch.equal(after["steps_left"][kept], before["steps_left"][kept] - 1)
        fresh = after["steps_left"][goes_on & arrived]
        left = (library.last_frame - torch.arange(len(library)))[stepped["next", "motion", "frame"][goes_on & arrived]]
        assert ((fresh[:, 0] >= 3) | (fresh[:, 0] == left)).all()
        assert (fresh <= 6).all()


def test_goal_is_the_target_in_the_robots_frame(library):
    env = make_keyframe_env(library, 8)
    state = env.reset()
    target = library.poses(state["command", "target_frame"])
    goal = robot_centric_goal(target, state["state", "root_pos_w"], state["state", "root_quat_w"])
    for key, value in goal.items():
        torch.testing.assert_close(state["goal", key], value)
    frames = state["command", "target_frame"] - state["motion", "frame"]
    assert torch.equal(state["command", "steps_left"][:, 0], frames)
    torch.testing.assert_close(state["command", "horizon"][:, 0], frames / 50)


def test_drawn_commands_cover_the_horizon(library):
    command = KeyframeCommand(library, HORIZONS["mixed"])
    start = library.clip_start[torch.zeros(4000, dtype=torch.int64)]
    steps = command._next_target(start) - start
    assert (steps.min(), steps.max()) == (1, 50)
    assert abs(steps.float().mean() - 25.5) < 1


def test_a_schedule_of_given_arrivals(library: MotionLibrary) -> None:
    drawn = CommandSchedule(library, HORIZONS["medium"], seed=3)
    starts = library.clip_start.tolist()
    ends = [
        sorted({int(f) - start for f in drawn.target_frame[start : start + length] if f >= 0})
        for start, length in zip(starts, library.clip_length.tolist(), strict=True)
    ]
    given = CommandSchedule.of_arrivals(library, ends)
    assert torch.equal(given.target_frame, drawn.target_frame)
    assert torch.equal(given.command_of_frame, drawn.command_of_frame)
    assert torch.equal(given.first_frame, drawn.first_frame)
    assert 11 <= given.horizon.shortest <= given.horizon.longest <= 25


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ([[10]], r"arrivals in 1 clip, 1 in all, expected some in \d+ clips"),
        ([[], []], "arrivals in 2 clips, 0 in all, expected some in 2 clips"),
        ([[10], [60]], r"motion 'b' has arrivals at \[60\], expected frames in ascending order, from 1 to 50"),
        ([[10, 10], [50]], "motion 'standing' has arrivals at"),
        ([[0, 10], [50]], "motion 'standing' has arrivals at"),
    ],
)
def test_arrivals_that_are_not_in_their_clip(ends, message):
    library = MotionLibrary.from_clips([standing_clip(frames=31), standing_clip("b", frames=31)])
    assert library.clip_length.tolist() == [51, 51]
    with pytest.raises(TaskError, match=message):
        CommandSchedule.of_arrivals(library, ends)


def test_schedules_of_other_things(library):
    with pytest.raises(TaskError, match="horizon is 'mixed', expected a Horizon"):
        CommandSchedule(library, "mixed", seed=0)
    schedule = CommandSchedule(library, HORIZONS["long"], seed=0)
    for shape in ((3,), (2, 46)):
        with pytest.raises(TaskError, match=r"parts have shape .*, expected \(\d+, 46\) or \(46,\)"):
            schedule.with_parts(torch.ones(shape))
    assert schedule.with_parts(torch.ones(46)).parts.shape == (schedule.num_commands, 46)
    nothing = torch.ones(schedule.num_commands, 46)
    nothing[1] = 0
    with pytest.raises(TaskError, match="parts of a command are all 0, expected something to be commanded"):
        schedule.with_parts(nothing)


def test_settings_out_of_bounds_are_named(library):
    with pytest.raises(PlatError, match="commands: window is 0, expected a whole number of at least 1"):
        KeyframeClock(0)
    with pytest.raises(PlatError, match="commands: partial is 2.0, expected a number from 0 to 1"):
        KeyframeCommand(library, HORIZONS["mixed"], partial=2.0)
