import math

import pytest
import torch
from tensordict import TensorDict

from plat.collectors import PrivilegedGoals
from plat.envs import GeneralizedState
from plat.envs.transforms.settings import TerminationLimits
from plat.envs.transforms.terminations import off_pose
from plat.errors import PlatError
from plat.keyframes.partial import hands_of
from plat.robots import G1, ForwardKinematics
from plat.rotations import quat_from_rotvec, quat_multiply
from plat.spec.timing import Timing
from plat.tasks import AuthoredCosts, TimedKeyframes, TimedKeyframesConfig, TrackingCosts
from plat.tasks.balance import Balance
from plat.tasks.timed_keyframes import _keypoints


@pytest.fixture(scope="module")
def task(library):
    return TimedKeyframes(library, TimedKeyframesConfig(chains=12), reset_noise=None)


def line_of(task, memory):
    return task._line.state(task._line.way(memory))


def play(task, memory, steps):
    """Memories while nobody moves, command after command."""
    action = torch.zeros(len(memory["goal"]), 29)
    for _ in range(steps):
        memory = task.advance(memory, action)
        memory = task.renew(memory, task.table.state(memory["goal"]))
        yield memory


def test_a_chain_is_commanded_in_order_and_then_held(task):
    chains = task.chains
    number = chains.family.index("arms")
    _, memory = task.authored(torch.tensor([number]))
    first = int(chains.first_row[number])
    rows, arrivals = [int(memory["goal"]) - task._frames], []
    for age, later in enumerate(play(task, memory, int(chains.duration[number])), start=1):
        if (row := int(later["goal"]) - task._frames) != rows[-1]:
            rows.append(row)
            arrivals.append(age)
    assert rows == list(range(first + 1, first + 6))
    # a keyframe is commanded when the one before it has had its time
    assert arrivals == chains.steps[first + 1 : first + 5].cumsum(0).tolist()
    assert task.finished(later).all()


def test_on_the_line_only_moderation_is_charged(task):
    _, memory = task.authored(torch.tensor([task.chains.family.index("crouch")]))
    *_, memory = play(task, memory, 10)
    line = line_of(task, memory)
    weights = task.config.underway
    softened = weights.underway * task.config.tracking.root_pos * 0.01 + weights.root_lin_vel * 0.01
    assert float(task.cost(line, memory)) == pytest.approx(softened, abs=1e-3)
    fallen = line._replace(root_pos_w=line.root_pos_w - torch.tensor([0, 0, 0.4]))
    assert float(task.cost(fallen, memory)) > 0.3
    assert bool(task.failed(fallen, memory))
    assert not bool(task.failed(line, memory))


def test_leaning_costs_beyond_a_slight_lean(task):
    _, memory = task.authored(torch.tensor([task.chains.family.index("steps")]))
    line, lean = line_of(task, memory), task.config.underway.lean

    def cost(angle):
        turn = quat_from_rotvec(torch.tensor([[0.0, angle, 0.0]]))
        return float(task.cost(line._replace(root_quat_w=quat_multiply(turn, line.root_quat_w)), memory))

    pull = task.config.underway.underway * task.config.tracking.root_rot
    assert cost(0.25) - cost(0.0) == pytest.approx(pull * 0.25, abs=0.01)
    chord = 2 * math.sin(0.5)
    assert cost(1.0) - cost(0.0) == pytest.approx(pull * 1.0 + lean * (chord - 0.3), abs=0.02)


def test_moving_costs_more_while_a_pose_is_held(task):
    _, memory = task.authored(torch.tensor([task.chains.family.index("arms")]))
    still = task.table.state(memory["goal"])
    moving = still._replace(joint_vel=still.joint_vel + 1.0)
    held = memory.clone().set("before", memory["goal"])
    weights = task.config.underway
    for given, weight in ((memory, weights.joint_vel), (held, weights.still)):
        assert float(task.cost(moving, given) - task.cost(still, given)) == pytest.approx(weight, abs=1e-4)


@pytest.mark.parametrize("family", ["steps", "far"])
def test_who_arrives_within_reach_pays_for_speed(library, family):
    config = TimedKeyframesConfig(chains=4, families=("steps", "far"), underway=AuthoredCosts(arrival=0.3))
    task = TimedKeyframes(library, config)
    _, memory = task.authored(torch.tensor([task.chains.family.index(family)]))
    there = task.table.state(memory["goal"])
    moving = there._replace(root_lin_vel_w=torch.tensor([[0.6, 0.0, 0.0]]))
    always = config.underway.root_lin_vel
    held = memory.clone().set("before", memory["goal"]).set("age", memory["age"] + 1)
    for given, steps_left, pays in ((memory, 2, True), (memory, 3, False), (held, 0, False)):
        given = given.clone().set("steps_left", torch.tensor([steps_left]))
        more = float(task.cost(moving, given) - task.cost(there, given))
        weight = always + (config.underway.arrival if pays and family == "steps" else 0.0)
        assert more == pytest.approx(weight * 0.6, abs=0.01)


def test_being_out_of_balance_costs_while_a_pose_is_held(task):
    _, memory = task.authored(torch.tensor([task.chains.family.index("arms")]))
    state = task.table.state(task._first_row[task._chain[memory["goal"] - task._frames]])
    falling = state._replace(root_lin_vel_w=torch.tensor([[0.6, 0.0, 0.0]]))
    held = memory.clone().set("before", memory["goal"])
    weights = task.config.underway
    slow = weights.root_lin_vel * 0.59
    assert float(task.cost(falling, memory) - task.cost(state, memory)) == pytest.approx(slow, abs=1e-3)
    unbalance = float(Balance(G1)(falling))
    assert unbalance > 0.1
    more = []
    for age in range(100, 108):
        held["age"] = torch.tensor([age])
        more.append(float(task.cost(falling, held) - task.cost(state, held)))
    assert sum(more) / 8 == pytest.approx(slow + weights.balance * unbalance, abs=1e-3)


def test_who_has_not_arrived_may_move(task):
    _, memory = task.authored(torch.tensor([task.chains.family.index("steps")]))
    memory["before"] = memory["goal"].clone()
    goal = task.table.state(memory["goal"])
    for off, weight in ((0.1, task.config.underway.still), (0.3, task.config.underway.joint_vel)):
        there = goal._replace(root_pos_w=goal.root_pos_w + torch.tensor([off, 0.0, 0.0]))
        moving = there._replace(joint_vel=there.joint_vel + 1.0)
        assert float(task.cost(moving, memory) - task.cost(there, memory)) == pytest.approx(weight, abs=1e-4)


def test_whoever_is_sent_too_far_too_often_may_be_left_behind(task):
    chains = {name: task.chains.family.index(name) for name in ("far", "steps")}
    for name, behind in (("far", False), ("steps", True)):
        _, memory = task.authored(torch.tensor([chains[name]]))
        state = line_of(task, memory)
        away = state._replace(root_pos_w=state.root_pos_w + torch.tensor([3.0, 0.0, 0.0]))
        assert bool(task.failed(away, memory)) == behind


def test_in_its_window_a_keyframe_costs_more(task):
    _, memory = task.along(torch.tensor([5]))
    state = task.table.state(memory["frame"])
    moved = state._replace(joint_pos=state.joint_pos + 0.2)
    early = memory.copy().set("steps_left", torch.tensor([3])).set("goal", memory["frame"])
    late = early.copy().set("steps_left", torch.tensor([2]))
    difference = float(task.cost(moved, late) - task.cost(moved, early))
    assert difference == pytest.approx(3.0 * 0.2 + 2.0 * 0.01, abs=1e-3)


def kicked(task, by=0.8):
    """A robot on its motion but for the left hip, and its memory at the arrival of a keyframe."""
    _, memory = task.along(torch.tensor([5]))
    state = task.table.state(memory["frame"])
    off = torch.zeros(task.robot.num_joints)
    off[task.robot.joint_names.index("left_hip_pitch")] = by
    arrival = memory.copy().set("steps_left", torch.tensor([0])).set("goal", memory["frame"])
    if task.partial:
        arrival["parts"] = torch.tensor([0])
    return state._replace(joint_pos=state.joint_pos - off), arrival


@pytest.mark.parametrize("partial", [0.0, 0.5])
def test_in_the_window_of_a_whole_keyframe_end_effectors_cost(library, partial):
    costs = []
    for weight in (0.0, 6.0):
        config = TimedKeyframesConfig(chains=6, partial=partial, tracking=TrackingCosts(end_effectors=weight))
        task = TimedKeyframes(library, config)
        state, arrival = kicked(task)
        early = arrival.copy().set("steps_left", torch.tensor([3]))
        costs.append((float(task.cost(state, arrival)), float(task.cost(state, early))))
    points, _ = ForwardKinematics(task.robot)(state.root_pos_w, state.root_quat_w, state.joint_pos)
    ankle = task.robot.keypoints.index("left_ankle_roll_link")
    away = float((points - task.table.points(arrival["goal"]))[0, ankle].norm())
    assert costs[1][0] - costs[0][0] == pytest.approx(6.0 * away / 4, abs=0.05)
    assert costs[1][1] == costs[0][1]


def test_a_keyframe_is_missed_with_a_foot_too_high(task):
    state, arrival = kicked(task, by=1.2)
    underway = arrival.copy().set("steps_left", torch.tensor([1]))
    assert task.missed(state, arrival).item()
    assert not task.missed(state, underway).item()
    assert not task.missed(task.table.state(arrival["goal"]), arrival).item()
    assert not task.missed(state, arrival.copy().set("authored", torch.tensor([True]))).item()


@pytest.mark.parametrize("body", ["torso_link", "left_ankle_roll_link", "right_knee_link"])
def test_a_keyframe_is_missed_as_evaluation_says(task, body):
    poses = task.table.state(torch.tensor([5, 5, 5]))
    pose = _keypoints(poses, task.table.points(torch.tensor([5, 5, 5])))
    pose["keypoint_quat_w"] = pose["keypoint_quat_w"].expand(-1, len(G1.keypoints), -1)
    robots, number = pose.clone(), G1.keypoints.index(body)
    robots["keypoint_pos_w"][:, number, 2] += torch.tensor([-0.3, -0.2, 0.3])
    assert task._off(robots, pose).equal(off_pose(robots, pose, G1, TerminationLimits()))


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


@pytest.mark.parametrize("partial", [0.0, 1.0])
def test_the_line_may_pull_at_nothing_before_the_window(library, partial):
    config = TimedKeyframesConfig(chains=20, partial=partial, underway=AuthoredCosts(underway=0.0))
    task = TimedKeyframes(library, config)
    state, memory = task.authored(torch.arange(20))
    cost = task.cost(state, memory)
    assert cost.isfinite().all()
    # a partial keyframe leaves the line's pull to what it does not command
    aside = state._replace(root_pos_w=state.root_pos_w + torch.tensor([0.0, 0.5, 0.0]))
    pull = config.underway.not_commanded * config.tracking.root_pos * 0.5 if partial else 0.0
    assert float((task.cost(aside, memory) - cost).mean()) == pytest.approx(pull, abs=0.01)


@pytest.fixture(scope="module")
def bent(library):
    """A task, and its memory at the begin of a command whose straight line leads through the robot itself."""
    config = TimedKeyframesConfig(chains=40, families=("reach",), partial=1.0)
    task = TimedKeyframes(library, config, reset_noise=None, seed=5)
    row = int((task.chains.middle_row >= 0).nonzero()[0, 0])
    _, memory = task.authored(task.chains.chain[[row]])
    memory["before"], memory["goal"] = torch.tensor([task._frames + row - 1]), torch.tensor([task._frames + row])
    memory["steps_left"], memory["length"] = torch.tensor([30]), torch.tensor([30])
    return task, memory, task.chains.middle[task.chains.middle_row[row]]


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


def test_a_bent_line_pulls_as_strongly_as_configured(bent):
    task, memory, _ = bent
    weights, moderate = task.config.tracking, task.config.underway
    half = memory.copy().set("steps_left", torch.tensor([15]))
    line = line_of(task, half)
    off = line._replace(joint_pos=line.joint_pos.clone())
    off.joint_pos[:, task.robot.joint_names.index("left_wrist_yaw")] += 0.2
    points = [task._kinematics.positions(*state[:3]) for state in (off, line)]
    hands = [task.robot.keypoints.index(name) for name in hands_of(task.robot)]
    moved = float(sum((points[0] - points[1])[0, hand].norm() for hand in hands)) / 2
    expected = moderate.around * (weights.joint_pos * 0.2 / task.robot.num_joints + weights.bodies * moved)
    assert float(task.cost(off, half) - task.cost(line, half)) == pytest.approx(expected, abs=2e-3)
    straight = half.copy().set("before", half["goal"])
    assert float(task.cost(task.table.state(half["goal"]), straight)) < 0.02


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
