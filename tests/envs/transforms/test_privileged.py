import torch

from plat.envs import entry_shapes, make_tracking_env
from plat.envs.transforms import PrivilegedState


def test_on_the_reference_the_errors_are_those_of_one_frame(library):
    env = make_tracking_env(library, 16)
    state = env.base_env.reset()
    out = PrivilegedState(library).compute(state)
    frame = state["motion", "frame"]
    ahead = library.states((frame + 1).minimum(library.last_frame[frame]))
    torch.testing.assert_close(out["privileged", "joint_vel_error"], ahead["joint_vel"] - state["state", "joint_vel"])
    assert {key[1]: tuple(value.shape[1:]) for key, value in out.items()} == entry_shapes("privileged", library.robot)
    # keypoint 0 is the root itself
    assert out["privileged", "keypoint_pos_b"][:, :3].abs().max() < 1e-5
    torch.testing.assert_close(
        out["privileged", "keypoint_lin_vel_b"][:, :3], state["robot", "root_lin_vel_b"], atol=1e-4, rtol=0
    )
