from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import torch
from tensordict import TensorDictBase

from plat.baselines import Tracker
from plat.control.authored import Authored, author
from plat.envs.state import GeneralizedState
from plat.envs.transforms import CommandSchedule, Horizon
from plat.evaluation import EvaluationSetting, ReferenceView, evaluate, make_evaluation_env
from plat.evaluation.authored_rollout import AuthoredRollout, Pushes
from plat.evaluation.in_between import InBetween
from plat.keyframes import KeyframeSequence
from plat.motions import MotionLibrary
from plat.robots import G1
from plat.rotations import quat_angle
from tests.conftest import standing_clip
from tests.evaluation.puppet import still


@pytest.fixture(scope="module")
def clips() -> MotionLibrary:
    """100 control steps of sliding at 0.3 m/s and turning at 0.5 rad/s."""
    return MotionLibrary.from_clips([standing_clip(frames=61)])


def command(library: MotionLibrary, steps_left: int, speed: float = 0.0) -> TensorDictBase:
    """A command of 40 steps, issued on the first frame to a robot that moves at some speed."""
    start = GeneralizedState.from_motion(library.states(torch.tensor([0])))
    start = start._replace(root_lin_vel_w=torch.tensor([[0.0, speed, 0.0]]), joint_vel=torch.full((1, 29), speed))
    out = library.poses(torch.tensor([0])).empty()
    out["command", "target_frame"] = torch.tensor([40])
    out["command", "steps_left"] = torch.tensor([[steps_left]])
    out["plan", "start"], out["plan", "length"] = start.pack(), torch.tensor([[40]])
    return out


@pytest.mark.parametrize("ahead", [1, 10, 20])
def test_a_line_to_a_keyframe_on_a_straight_motion_is_the_motion(clips, ahead):
    motion, frames = InBetween(clips, "line"), torch.tensor(ahead)
    poses, wanted = motion.poses(command(clips, 20), frames), clips.poses(torch.tensor([20 + ahead]))
    # the root of the clip turns while it slides along x: both are linear in time
    torch.testing.assert_close(poses["root_pos"], wanted["keypoint_pos"][:, 0], atol=1e-4, rtol=0)
    assert quat_angle(poses["root_quat"], wanted["keypoint_quat"][:, 0]).max() < 1e-3
    torch.testing.assert_close(poses["keypoint_pos"], wanted["keypoint_pos"], atol=1e-3, rtol=0)
    velocities = motion.velocities(command(clips, 20), torch.tensor(1))
    torch.testing.assert_close(velocities["root_lin_vel_w"], torch.tensor([[0.3, 0.0, 0.0]]), atol=1e-3, rtol=0)
    torch.testing.assert_close(velocities["root_ang_vel_w"], torch.tensor([[0.0, 0.0, 0.5]]), atol=1e-3, rtol=0)


@pytest.mark.parametrize("interface", ["line", "cascade"])
def test_both_rest_at_the_keyframe(clips, interface):
    motion, at_rest = InBetween(clips, interface), command(clips, 5, speed=1.0)
    wanted = clips.poses(torch.tensor([40]))
    frames = torch.tensor([5, 6, 50])
    poses = motion.poses(at_rest, frames)
    assert poses["keypoint_pos"].shape == (1, 3, 14, 3)
    torch.testing.assert_close(
        poses["keypoint_pos"], wanted["keypoint_pos"][:, None].expand(-1, 3, -1, -1), atol=1e-4, rtol=0
    )
    for value in motion.velocities(at_rest, frames).values():
        torch.testing.assert_close(value, torch.zeros_like(value), atol=1e-4, rtol=0)


def test_a_cascade_goes_on_from_the_robots_velocity(clips):
    line, cascade = (InBetween(clips, interface) for interface in ("line", "cascade"))
    moving = command(clips, 40, speed=0.8)
    first, later = (cascade.velocities(moving, torch.tensor(ahead)) for ahead in (0, 20))
    assert first["root_lin_vel_w"][0, 1] == pytest.approx(0.8, rel=0.12)  # the mean over its first frame
    assert first["joint_vel"].mean() == pytest.approx(0.8, rel=0.12)
    # after 0.4 s it is the line
    assert later["root_lin_vel_w"][0].tolist() == pytest.approx([0.3, 0.0, 0.0], abs=2e-3)
    torch.testing.assert_close(
        cascade.poses(moving, torch.tensor(20))["keypoint_pos"], line.poses(moving, torch.tensor(20))["keypoint_pos"]
    )


def test_a_plan_begins_where_the_robot_is_when_its_command_is_issued(clips):
    schedule = CommandSchedule(clips, Horizon(20, 20), seed=0)
    view = ReferenceView(interface="line")
    task = make_evaluation_env(clips, schedule, 1, view, EvaluationSetting(num_threads=1))
    starts: list[torch.Tensor] = []
    states: list[torch.Tensor] = []
    for step in task.steps(still):
        starts.append(step["plan", "start"][0])
        states.append(GeneralizedState.from_entries(step).pack()[0])
        assert int(step["plan", "length"]) == 20
        if len(starts) == 41:
            break
    task.close()
    for issued in (0, 20, 40):
        torch.testing.assert_close(starts[issued], states[issued])
    assert torch.equal(starts[19], starts[0])
    assert not torch.equal(starts[20], starts[19])


def test_policies_read_the_in_between_motion_as_their_goal(clips):
    seen: list[float] = []

    def policy(tensordict: TensorDictBase) -> TensorDictBase:
        seen.append(float(tensordict["goal", "root_pos_b"][0].norm()))
        return still(tensordict)

    records = evaluate(policy, clips, Horizon(50, 50), interface="line", num_envs=1)
    assert len(records.clip) == 2
    assert seen[0] < 0.02  # a frame ahead; the keyframe is 0.3 m away


def held_chains(family: str) -> list[Authored]:
    """Chains of 0.2 s and 0.3 s to each keyframe, and 0.3 s of hold."""
    chains = []
    for chain, times in zip(author(family, G1, 2, seed=0), ((0.2, 0.5), (0.3, 0.5)), strict=True):
        frames = [frame.at(time) for frame, time in zip(chain.sequence.keyframes, times, strict=False)]
        chains.append(replace(chain, sequence=KeyframeSequence(G1, chain.sequence.start, tuple(frames)), hold=0.3))
    return chains


@pytest.mark.parametrize("ahead", [0, 1, (0, 1, 5, 45)])
@pytest.mark.parametrize("interface", ["next-frame", "line", "cascade"])
def test_what_a_tracker_is_shown_in_a_hold_is_the_keyframe_at_rest(interface, ahead):
    """The robot, which is shoved, is elsewhere. Up to the arrival the reference leads to the keyframe."""
    shown: list[TensorDictBase] = []

    class Looker(Tracker):
        def targets(self, tensordict, joint_pos, starting):
            shown.append(tensordict.select("tracker_reference", "state").clone())
            return self.robot.default_joint_pos.expand_as(joint_pos)

    tracker = Looker(G1)
    tracker.ahead = ahead
    chains = [chain for family in ("arms", "steps", "crouch", "reach") for chain in held_chains(family)]
    observe = ReferenceView(observe=tracker.observe, interface=interface).transforms
    rollout = AuthoredRollout(tracker, G1, chains, observe=observe, pushes=Pushes(1.0, every=0.4), num_threads=1)
    number = len(list(rollout))
    assert number == len(shown) == 40
    held = shown[25:]
    velocities = ("joint_vel", "root_lin_vel_w", "root_ang_vel_w")
    for row, chain in enumerate(chains):
        last = chain.sequence.keyframes[-1]
        for step in held:
            reference = step["tracker_reference"][row].view(-1)
            for name in velocities:
                assert reference[name].abs().max() < 1e-3, name
            for name, pose in (("root_pos_w", last.root_pos), ("joint_pos", last.joint_pos)):
                wanted = torch.from_numpy(np.asarray(pose, dtype=np.float32)).expand_as(reference[name])
                torch.testing.assert_close(reference[name], wanted, atol=1e-5, rtol=0)
            assert quat_angle(reference["root_quat_w"], torch.from_numpy(last.root_quat).float()).max() < 2e-3
        assert (held[-1]["state", "root_pos_w"][row] - torch.from_numpy(last.root_pos).float()).norm() > 0.05
        # a step before the arrival, the next frame is the keyframe already: it is continuous
        arriving = shown[24]["tracker_reference"][row].view(-1)
        if ahead != 0:
            ends = -1 if ahead == 1 else slice(1, None)
            torch.testing.assert_close(
                arriving["root_pos_w"][ends], held[0]["tracker_reference"][row].view(-1)["root_pos_w"][ends]
            )


@pytest.mark.parametrize("interface", ["line", "cascade"])
def test_a_command_of_one_step_to_another_pose_begins_where_the_robot_is(clips, interface):
    schedule = CommandSchedule(clips, Horizon(1, 1), seed=0)
    task = make_evaluation_env(clips, schedule, 1, ReferenceView(interface=interface), EvaluationSetting(num_threads=1))
    for step in islice(task.steps(still), 10):
        torch.testing.assert_close(step["plan", "start"], GeneralizedState.from_entries(step).pack())
    task.close()
