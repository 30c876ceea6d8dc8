import math

import pytest
import torch

from plat.keyframes.partial import hands_of
from plat.robots import G1, ForwardKinematics
from plat.rotations import quat_from_rotvec, quat_multiply
from plat.tasks import AuthoredCosts, TimedKeyframes, TimedKeyframesConfig, TrackingCosts
from plat.tasks.balance import Balance
from tests.tasks.keyframe_tasks import bent_task, kicked, line_of, play, whole_task


@pytest.fixture(scope="module")
def task(library):
    return whole_task(library)


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
    state = task.table.state(task.chain_rows.first_row[task.chain_rows.chain(memory["goal"])])
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


def test_in_its_window_a_keyframe_costs_more(task):
    _, memory = task.along(torch.tensor([5]))
    state = task.table.state(memory["frame"])
    moved = state._replace(joint_pos=state.joint_pos + 0.2)
    early = memory.copy().set("steps_left", torch.tensor([3])).set("goal", memory["frame"])
    late = early.copy().set("steps_left", torch.tensor([2]))
    difference = float(task.cost(moved, late) - task.cost(moved, early))
    assert difference == pytest.approx(3.0 * 0.2 + 2.0 * 0.01, abs=1e-3)


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
    return bent_task(library)


def test_a_bent_line_pulls_as_strongly_as_configured(bent):
    task, memory, _ = bent
    weights, moderate = task.config.tracking, task.config.underway
    half = memory.copy().set("steps_left", torch.tensor([15]))
    line = line_of(task, half)
    off = line._replace(joint_pos=line.joint_pos.clone())
    off.joint_pos[:, task.robot.joint_names.index("left_wrist_yaw")] += 0.2
    points = [ForwardKinematics(task.robot).positions(*state[:3]) for state in (off, line)]
    hands = [task.robot.keypoints.index(name) for name in hands_of(task.robot)]
    moved = float(sum((points[0] - points[1])[0, hand].norm() for hand in hands)) / 2
    expected = moderate.around * (weights.joint_pos * 0.2 / task.robot.num_joints + weights.bodies * moved)
    assert float(task.cost(off, half) - task.cost(line, half)) == pytest.approx(expected, abs=2e-3)
    straight = half.copy().set("before", half["goal"])
    assert float(task.cost(task.table.state(half["goal"]), straight)) < 0.02


def test_another_cost_takes_its_place(library):
    class Dearer(torch.nn.Module):
        def __init__(self, costs):
            super().__init__()
            self.costs = costs

        def forward(self, state, memory):
            return self.costs(state, memory) + 1.0

    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6))
    state, memory = task.start(4)
    usual = task.cost(state, memory)
    task.costs = Dearer(task.costs)
    torch.testing.assert_close(task.cost(state, memory), usual + 1.0)
