import torch

from plat.collectors import rollouts, simulation_threads
from plat.envs import make_tracking_env
from plat.modules import Expert
from plat.motions import MotionLibrary, generate_motions
from plat.objectives import autocast
from plat.robots import G1


def small_env(num_envs: int = 2):
    return make_tracking_env(MotionLibrary.from_clips(generate_motions("train", seconds=8)), num_envs)


def test_each_rollout_goes_on_where_the_last_ended():
    batches = rollouts(small_env(), Expert(G1).actor(), steps=3)
    first, second = next(batches), next(batches)
    ended, begun = first["next", "motion", "frame"][:, -1], second["motion", "frame"][:, 0]
    going = ~first["next", "done"][:, -1, 0]
    assert torch.equal(begun[going], ended[going])


def test_the_loss_sees_the_probabilities_of_the_policy_that_acted():
    expert = Expert(G1)
    rollout = next(rollouts(small_env(), expert.actor(), steps=4, precision="bfloat16"))
    with torch.no_grad(), autocast("cpu", "bfloat16"):
        again = expert.head().get_dist(rollout.select("observation", ("goal", "joint_pos")))
    torch.testing.assert_close(again.log_prob(rollout["action"]), rollout["action_log_prob"], atol=1e-3, rtol=0)
    with torch.no_grad():
        exact = expert.head().get_dist(rollout.select("observation", ("goal", "joint_pos")))
    assert (exact.base_dist.loc - rollout["loc"]).abs().max() > 1e-5  # so half precision was in use


def test_the_caller_keeps_its_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        next(rollouts(small_env(), Expert(G1).actor(), steps=1))
        assert torch.get_num_threads() == 2
        with simulation_threads(64):
            assert torch.get_num_threads() == 1
        with simulation_threads(64 * 1024):
            assert torch.get_num_threads() == 2
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
