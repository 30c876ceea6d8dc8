from plat.envs import ROBOT_KEYS, goal_keys, make_tracking_env
from plat.modules import Critic
from plat.robots import G1


def test_critic_sees_more_than_the_policy(library):
    critic = Critic(G1, ROBOT_KEYS + goal_keys())
    assert any(key[0] == "privileged" for key in critic.observe().in_keys)
    state = make_tracking_env(library, 4).reset()
    assert critic.head()(critic.observe()(state))["state_value"].shape == (4, 1)
