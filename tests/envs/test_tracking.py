from copy import copy
from dataclasses import replace

import mujoco
import pytest
import torch
from tensordict import TensorDict
from torchrl.envs.utils import check_env_specs

from plat.envs import MotionTrackingEnv, ResetNoise
from plat.errors import MotionError, RobotError
from plat.motions import MotionLibrary
from plat.robots import G1
from tests.conftest import standing_clip


def reference_actions(env: MotionTrackingEnv, frame: torch.Tensor) -> torch.Tensor:
    ahead = (frame + 1).minimum(env.library.last_frame[frame])
    return (env.library.poses(ahead)["joint_pos"] - G1.default_joint_pos) / G1.action_scale


def test_specs(library):
    check_env_specs(MotionTrackingEnv(library, 4))


def test_starts_on_the_reference(library):
    env = MotionTrackingEnv(library, 16)
    state = env.reset()
    reference = library.states(state["motion", "frame"])
    for ours, theirs in (("keypoint_pos_w", "keypoint_pos"), ("keypoint_quat_w", "keypoint_quat")):
        torch.testing.assert_close(state["state", ours].abs(), reference[theirs].abs(), atol=1e-5, rtol=0)
    torch.testing.assert_close(state["state", "joint_vel"], reference["joint_vel"], atol=1e-4, rtol=0)
    # keypoint velocities by finite differences and by kinematics agree to the differences' own error
    error = state["state", "keypoint_lin_vel_w"] - reference["keypoint_lin_vel"]
    assert error.abs().mean() < 0.01


def test_robot_frame_quantities():
    env = MotionTrackingEnv(MotionLibrary.from_clips([standing_clip()]), 4)
    robot = env.reset()["robot"]
    # sliding at 0.3 m/s along the world's x, upright, turning at 0.5 rad/s
    torch.testing.assert_close(robot["root_lin_vel_b"].norm(dim=-1), torch.full((4,), 0.3), atol=5e-3, rtol=0)
    torch.testing.assert_close(robot["root_ang_vel_b"], torch.tensor([0, 0, 0.5]).expand(4, 3), atol=5e-3, rtol=0)
    torch.testing.assert_close(robot["gravity_b"], torch.tensor([0, 0, -1.0]).expand(4, 3), atol=1e-5, rtol=0)
    assert robot["joint_pos"].abs().max() < 1e-5
    assert (robot["last_action"] == 0).all()


def test_action_offsets_the_default_pose(library):
    env = MotionTrackingEnv(library, 2)
    state = env.reset()
    state["action"] = torch.ones(2, 29)
    env.step(state)
    target = torch.from_numpy(env.physics.batch.bind("ctrl")).float()
    torch.testing.assert_close(target, (G1.default_joint_pos + G1.action_scale).expand(2, -1))
    assert (state["next", "robot", "last_action"] == 1).all()


def test_a_delayed_robot_acts_late(library):
    env = MotionTrackingEnv(library, 3)
    env.delay[:] = torch.arange(3)
    state = env.reset()
    for given in (1, 2, 3, 4):
        state["action"] = torch.full((3, 29), float(given))
        env.step(state)
        target = torch.from_numpy(env.physics.batch.bind("ctrl")).float()
        arrived = (target - G1.default_joint_pos) / G1.action_scale
        expected = torch.tensor([given, given - 1, max(given - 2, 0)]).float()
        torch.testing.assert_close(arrived, expected[:, None].expand(-1, 29), atol=1e-5, rtol=0)
        state = state["next"].exclude("reward")


def test_encoder_bias_is_seen_and_acted_on(library):
    env = MotionTrackingEnv(library, 2)
    start = TensorDict({"motion": TensorDict({"start": torch.zeros(2, dtype=torch.int64)}, [2])}, [2])
    plain = env._reset(start)["robot", "joint_pos"]
    env.encoder_bias[1] = 0.01
    biased = env._reset(start)["robot", "joint_pos"]
    torch.testing.assert_close(biased[1] - plain[1], torch.full((29,), 0.01))
    torch.testing.assert_close(biased[0], plain[0])


def test_frames_advance_and_clips_end(library):
    env = MotionTrackingEnv(library, 3)
    ends = library.last_frame[library.clip_start[:3]]
    start = TensorDict({"motion": TensorDict({"start": ends - 2}, [3])}, [3])
    state = env._reset(start)
    for expected in (False, True):
        state["action"] = reference_actions(env, state["motion", "frame"])
        env.step(state)
        assert (state["next", "truncated"] == expected).all()
        assert not state["next", "terminated"].any()
        state = state["next"].exclude("reward")
    assert torch.equal(state["motion", "frame"], ends)
    # what follows in the table is another clip
    after = env.step(state.set("action", torch.zeros(3, 29)))["next"]
    assert after["truncated"].all()
    assert torch.equal(after["motion", "frame"], ends)


def test_an_episode_at_the_last_frame_is_over_after_a_step(library):
    env = MotionTrackingEnv(library, 2, min_frames_left=0)
    last = library.last_frame[library.clip_start[[0, -1]]]
    state = env.reset(TensorDict({"motion": {"start": last}}, [2]))
    after = env.step(state.set("action", torch.zeros(2, 29)))["next"]
    assert after["truncated"].all()
    assert torch.equal(after["motion", "frame"], last)


@pytest.mark.parametrize("start", [-1, 10**6])
def test_starts_that_are_no_frames(library, start):
    with pytest.raises(MotionError, match=rf"motion.start is {start} to {start}, expected frames of the motions, 0 to"):
        MotionTrackingEnv(library, 1).reset(TensorDict({"motion": {"start": torch.tensor([start])}}, [1]))


@pytest.mark.parametrize("start", [[True, False], [0.0, 1.0], [0]])
def test_starts_that_are_no_whole_numbers(library, start):
    with pytest.raises(MotionError, match="start is .*, expected a whole number for each robot"):
        MotionTrackingEnv(library, 2).reset(start=torch.tensor(start))


def test_a_mask_resets_only_its_robots(library):
    env = MotionTrackingEnv(library, 4)
    state = env.reset()
    for _ in range(3):
        state["action"] = reference_actions(env, state["motion", "frame"])
        env.step(state)
        state = state["next"].exclude("reward")
    before = state.clone()
    mask = torch.tensor([[False], [True], [False], [True]])
    after = env.reset(state.update({"_reset": mask}))
    keep = ~mask[:, 0]
    for key in before.keys(True, True):
        assert torch.equal(after[key][keep], before[key][keep]), key
    assert (after["robot", "last_action"][~keep] == 0).all()
    assert torch.equal(env.qpos[keep, :3], before["state", "root_pos_w"][keep])


def test_starts_leave_enough_frames():
    library = MotionLibrary.from_clips([standing_clip(frames=40), standing_clip("long", frames=61)])
    env = MotionTrackingEnv(library, 64, min_frames_left=60)
    frame = env.reset()["motion", "frame"]
    assert (library.last_frame[frame] - frame >= 60).all()
    assert set(library.clip_of_frame[frame].tolist()) <= {0, 1}


def test_no_clip_is_long_enough():
    library = MotionLibrary.from_clips([standing_clip(frames=31)])
    with pytest.raises(
        MotionError, match="motion 'standing' is the longest with 50 control steps, expected at least 60"
    ):
        MotionTrackingEnv(library, 2, min_frames_left=60)


def test_reset_noise_is_within_its_bounds(library):
    noise = ResetNoise()
    env = MotionTrackingEnv(library, 256, reset_noise=noise)
    state = env.reset()
    reference = library.states(state["motion", "frame"])
    offset = state["state", "root_pos_w"] - reference["keypoint_pos"][:, 0]
    bounds = torch.tensor([noise.root_pos_xy, noise.root_pos_xy, noise.root_pos_z])
    assert (offset.abs() <= bounds + 1e-5).all()
    assert (offset.abs().amax(0) > 0.8 * bounds).all()
    low, high = G1.joint_range.T
    assert ((state["state", "joint_pos"] >= low - 1e-5) & (state["state", "joint_pos"] <= high + 1e-5)).all()


def test_same_seed_same_rollout(library):
    rollouts = []
    for _ in range(2):
        env = MotionTrackingEnv(library, 4, reset_noise=ResetNoise())
        env.set_seed(3)
        rollouts.append(env.rollout(5, lambda td: td.set("action", torch.randn(4, 29))))
    assert torch.equal(rollouts[0]["next", "robot", "joint_pos"], rollouts[1]["next", "robot", "joint_pos"])


def test_past_steps_keep_their_values(library):
    # MuJoCo's arrays are live; a rollout that kept views of them would hold the last state in every step
    env = MotionTrackingEnv(library, 2)
    rollout = env.rollout(6, break_when_any_done=False)
    heights = rollout["next", "state", "keypoint_pos_w"][0, :, :, 2]
    assert (heights[1:] != heights[:-1]).any(-1).all()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="self_contact"', 'name="itself"', "robot 'g1': sensor 'self_contact' is missing"),
        (
            'body1="left_ankle_roll_link" body2="world" reduce="netforce" data="found force"',
            'body1="left_ankle_roll_link" body2="world" data="found"',
            'sensor \'left_foot_contact\' reads 1 number, expected .* reduce="netforce" data="found force"',
        ),
    ],
)
def test_sensors_are_found_by_their_names(library, tmp_path, old, new, message):
    text = G1.asset_path.read_text()
    assert old in text
    (tmp_path / "g1.xml").write_text(text.replace(old, new))
    robot = replace(G1, asset=str(tmp_path / "g1.xml"))
    library = copy(library)
    library.robot = robot
    with pytest.raises(RobotError, match=message):
        MotionTrackingEnv(library, 1)


def stray_contacts(qpos: torch.Tensor) -> float:
    """Count contacts of a pose with the floor that are not of feet, and those of the robot with itself."""
    model = G1.shared_model
    data = mujoco.MjData(model)
    data.qpos[:] = qpos.numpy()
    mujoco.mj_fwdPosition(model, data)
    feet = [model.body(name).id for name in G1.feet]
    pairs = [model.geom_bodyid[contact.geom].tolist() for contact in data.contact]
    return float(sum(not (0 in pair and (pair[0] in feet or pair[1] in feet)) for pair in pairs))


def test_stray_contacts_are_those_of_the_same_moment(library):
    env = MotionTrackingEnv(library, 4)
    state = env.reset()
    moments = [state]
    for _ in range(25):  # feet land and leave the floor
        after = env.step(state.set("action", torch.randn(4, 29)))["next"].clone()
        assert after["state", "stray_contacts"][:, 0].tolist() == [stray_contacts(qpos) for qpos in env.qpos]
        moments.append(after)
        state = after.exclude("reward")
    assert torch.stack([moment["state", "foot_force"] for moment in moments[1:]]).any()
    again = env.reset()
    assert again["state", "stray_contacts"][:, 0].tolist() == [stray_contacts(qpos) for qpos in env.qpos]
    for key in ("foot_force", "joint_torque"):
        assert not again["state", key].any(), key


def test_the_order_of_the_sensors_does_not_matter(library, tmp_path):
    lines = G1.asset_path.read_text().splitlines()
    sensors = [line for line in lines if "<contact name" in line]
    for line in sensors:
        lines.remove(line)
    lines[lines.index("  <sensor>") + 1 : lines.index("  <sensor>") + 1] = sensors[::-1]
    (tmp_path / "g1.xml").write_text("\n".join(lines))
    states = []
    for robot in (G1, replace(G1, asset=str(tmp_path / "g1.xml"))):
        library = copy(library)
        library.robot = robot
        env = MotionTrackingEnv(library, 3)
        env.set_seed(0)
        states.append(env.rollout(10, lambda td: td.set("action", torch.zeros(3, 29)))["next", "state"])
    for key in ("foot_force", "stray_contacts"):
        assert torch.equal(states[0][key], states[1][key])
        assert states[0][key].any()
