import pytest
import torch
from tensordict import TensorDict

from plat.baselines import Tracker, twist2_robot
from plat.envs import G1


class Counter(Tracker):
    """Asks for the number of steps since the start, as an angle, of every joint."""

    def targets(self, tensordict, joint_pos, starting):
        count = self.remembered("count", joint_pos, starting) + 1
        self.remember("count", count)
        return count


def observed(starting: list[bool]) -> TensorDict:
    count = len(starting)
    robot = TensorDict({"joint_pos": torch.zeros(count, 29)}, [count])
    return TensorDict({"robot": robot, "is_init": torch.tensor(starting)[:, None]}, [count])


def test_memory_is_each_robots_own():
    tracker = Counter(G1)
    tracker(observed([True, True]))
    tracker(observed([False, False]))
    action = tracker(observed([False, True]))["action"]
    targets = G1.default_joint_pos + G1.action_scale * action
    torch.testing.assert_close(targets, torch.tensor([[3.0], [1.0]]).expand(2, 29))


def test_another_number_of_robots_starts_anew():
    tracker = Counter(G1)
    tracker(observed([True]))
    targets = G1.default_joint_pos + G1.action_scale * tracker(observed([False, False]))["action"]
    torch.testing.assert_close(targets, torch.ones(2, 29))


def test_twist2_robot_has_its_own_motors():
    robot = twist2_robot()
    names = robot.joint_names
    for joint, stiffness, damping in (("left_knee", 150, 4), ("right_elbow", 40, 5), ("left_wrist_yaw", 4, 0.2)):
        index = names.index(joint)
        assert robot.stiffness[index] == stiffness
        assert robot.damping[index] == pytest.approx(damping)
        assert robot.effort_limit[index] == stiffness
    assert robot.name != G1.name
