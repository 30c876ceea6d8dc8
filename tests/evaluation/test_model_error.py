import csv

import torch
from tensordict import TensorDict

from plat.envs import GeneralizedState, MotionTrackingEnv, ResetNoise
from plat.evaluation.model_error import model_errors
from plat.modules import DynamicsConfig, DynamicsModel
from plat.robots import G1


def windows(library, robots=16, steps=6):
    env = MotionTrackingEnv(library, robots, reset_noise=ResetNoise(), min_frames_left=steps + 2)
    rollout = env.rollout(steps, lambda td: td.set("action", torch.zeros(robots, 29)))
    state = GeneralizedState.from_entries(rollout).pack()
    return TensorDict({"robot_state": state, "action": rollout["action"]}, [robots, steps])


def test_a_model_that_says_nothing_coasts(library):
    """Velocities go on: for a step that is better than to stay put."""
    model = DynamicsModel(G1, DynamicsConfig(hidden=(8,)))
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.zero_()
    data = windows(library)
    errors = model_errors(model, data)
    assert errors.root_pos.shape == (5,)
    assert errors.root_pos[0] < 0.5 * errors.still_root_pos[0]
    states = GeneralizedState.unpack(data["robot_state"])
    moved = (states.joint_pos[:, 3] - states.joint_pos[:, 0]).abs().mean()
    torch.testing.assert_close(errors.still_joint_pos[2], moved)
    assert (errors.root_pos.diff() > 0).all()


def test_the_table_has_a_row_a_step(library, tmp_path):
    errors = model_errors(DynamicsModel(G1, DynamicsConfig(hidden=(8,))), windows(library))
    errors.write(tmp_path / "errors.csv")
    with (tmp_path / "errors.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["step"] for row in rows] == ["1", "2", "3", "4", "5"]
    assert float(rows[2]["root_pos"]) == float(f"{float(errors.root_pos[2]):.6g}")
