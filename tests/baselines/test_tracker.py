import pytest
import torch
from tensordict import TensorDict

from plat.baselines import Tracker, twist2_robot
from plat.envs.transforms import HORIZONS
from plat.evaluation import evaluate
from plat.motions import MotionLibrary
from plat.robots import G1
from tests.conftest import standing_clip


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


@pytest.mark.parametrize("ahead", [3, (0, 4)])
def test_what_it_is_shown_of_commands_and_of_the_dense_reference(ahead):
    library = MotionLibrary.from_clips([standing_clip()])
    shown: list[tuple[int, torch.Tensor, torch.Tensor]] = []

    class Looker(Counter):
        def targets(self, tensordict, joint_pos, starting):
            reference = tensordict["tracker_reference"]
            target = int(tensordict["command", "target_frame"])
            shown.append((int(tensordict["motion", "frame"]), target, reference["root_pos_w"], reference["joint_vel"]))
            return self.robot.default_joint_pos.expand_as(joint_pos)

    tracker = Looker(G1)
    tracker.ahead = ahead
    wanted = torch.tensor([ahead]).flatten()
    for dense in (True, False):
        shown.clear()
        evaluate(tracker, library, HORIZONS["long"], dense=dense, observe=tracker.observe, num_threads=1)
        for frame, target, root_pos, joint_vel in shown:
            rows = (frame + wanted).clamp_max(len(library) - 1) if dense else torch.full_like(wanted, target)
            torch.testing.assert_close(root_pos.view(-1, 3), library.frames["keypoint_pos"][rows, 0])
            velocities = library.frames["joint_vel"][rows]
            assert torch.equal(joint_vel.view(-1, 29), velocities if dense else torch.zeros_like(velocities))
    assert len(shown) > 20


def test_it_starts_anew_after_every_reset(library):
    counts: list[torch.Tensor] = []

    class Collapse(Counter):
        def targets(self, tensordict, joint_pos, starting):
            count = super().targets(tensordict, joint_pos, starting)
            counts.append(count[:, 0].clone())
            return 5 * torch.ones_like(joint_pos)

    tracker = Collapse(G1)
    records = evaluate(tracker, library, HORIZONS["long"], observe=tracker.observe, num_envs=1, num_threads=1)
    starts = int((torch.cat(counts) == 1).sum())
    assert records.failed.all()  # so that each command begins with a reset
    assert starts == len(records.failed)
