"""Tasks of keyframes and moments in them, for the tests of what such a task is put together from."""

import torch

from plat.robots import G1
from plat.spec.parts import Parts
from plat.spec.timing import Timing
from plat.tasks import TimedKeyframes, TimedKeyframesConfig


def whole_task(library):
    """All keyframes are whole, and at most a second ahead."""
    return TimedKeyframes(library, TimedKeyframesConfig(chains=12), reset_noise=None)


def partial_task(library):
    """All keyframes are partial, and up to three seconds ahead."""
    config = TimedKeyframesConfig(chains=40, partial=1.0)
    return TimedKeyframes(library, config, timing=Timing(max_steps=150), reset_noise=None)


def bent_task(library):
    """A task, and its memory at the begin of a command whose straight line leads through the robot itself."""
    config = TimedKeyframesConfig(chains=40, families=("reach",), partial=1.0)
    task = TimedKeyframes(library, config, reset_noise=None, seed=5)
    row = int((task.chains.middle_row >= 0).nonzero()[0, 0])
    _, memory = task.authored(task.chains.chain[[row]])
    memory["before"], memory["goal"] = (task.chain_rows.first_row[:1] + (row - less) for less in (1, 0))
    memory["steps_left"], memory["length"] = torch.tensor([30]), torch.tensor([30])
    return task, memory, task.chains.middle[task.chains.middle_row[row]]


def line_of(task, memory):
    return task.line.state(task.line.way(memory))


def play(task, memory, steps):
    """Memories while nobody moves, command after command."""
    action = torch.zeros(len(memory["goal"]), 29)
    for _ in range(steps):
        memory = task.advance(memory, action)
        memory = task.renew(memory, task.table.state(memory["goal"]))
        yield memory


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


def row_of(task, **names):
    """The row of a mask, put in the task's table."""
    task.masks.table[1] = torch.tensor(Parts.only(G1, **names).values(), dtype=torch.float32)
    return torch.tensor([1])


def command(task, steps_left=10, **names):
    """A robot on its motion with a partial keyframe to come."""
    _, memory = task.along(torch.tensor([5]))
    memory["frame"], memory["steps_left"], memory["length"] = (
        torch.tensor([5]),
        torch.tensor([steps_left]),
        torch.tensor([30]),
    )
    memory["goal"] = torch.tensor([5 + steps_left])
    memory["parts"] = row_of(task, **names)
    return task.table.state(memory["frame"]), memory
