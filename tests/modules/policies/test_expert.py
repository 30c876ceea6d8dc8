import pytest
import torch
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.envs import ROBOT_KEYS, goal_keys, make_keyframe_env, make_tracking_env
from plat.errors import ConfigError
from plat.modules import Expert, ExpertConfig
from plat.robots import G1

SYMMETRY = pytest.mark.parametrize("symmetric", [False, True])


@SYMMETRY
def test_deployed_is_the_actors_mean(library, symmetric):
    expert = Expert(G1, ExpertConfig(symmetric=symmetric))
    state = make_tracking_env(library, 4).reset()
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        acted = expert.actor()(state.clone())
    torch.testing.assert_close(expert.deployed()(state.clone())["action"], acted["action"])
    torch.testing.assert_close(acted["action"], acted["loc"])


@SYMMETRY
def test_head_reads_what_the_actor_wrote(library, symmetric):
    expert = Expert(G1, ExpertConfig(symmetric=symmetric))
    rollout = expert.actor()(make_tracking_env(library, 4).reset())
    dist = expert.head().get_dist(rollout.select(*expert.head().in_keys))
    torch.testing.assert_close(dist.log_prob(rollout["action"]), rollout["action_log_prob"])


def untrained(config: ExpertConfig | None = None) -> Expert:
    expert = Expert(G1, config)
    torch.nn.init.zeros_(expert.network[-1].weight)
    torch.nn.init.zeros_(expert.network[-1].bias)
    return expert


def test_untrained_expert_commands_the_reference(library):
    expert = untrained()
    state = make_tracking_env(library, 4).reset()
    action = expert.deployed()(state)["action"]
    torch.testing.assert_close(G1.default_joint_pos + G1.action_scale * action, state["goal", "joint_pos"])


def test_default_offset_ignores_the_goals_angles_outside_the_network(library):
    expert = untrained(ExpertConfig(action="default_offset"))
    state = make_tracking_env(library, 4).reset()
    assert (expert.deployed()(state)["action"] == 0).all()


def test_labels_are_in_the_students_parametrisation(library):
    # a label is an action of the environment: taken as it is, it does what the expert would have done
    expert = Expert(G1)
    keyframe = make_keyframe_env(library, 4).reset()
    label = expert.deployed("dense_goal", out_key="expert_action")(keyframe)["expert_action"]
    dense = keyframe.select("robot").update({"goal": keyframe["dense_goal"]})
    torch.testing.assert_close(label, expert.deployed()(dense)["action"])


def test_policy_sees_nothing_privileged():
    assert set(Expert(G1).deployed().in_keys) == {*ROBOT_KEYS, *goal_keys()}


def test_an_expert_that_sees_several_frames(library):
    expert = Expert(G1, ExpertConfig(ahead=(1, 6, 11)))
    assert expert.goals == {"goal": 1, "goal_6": 6, "goal_11": 11}
    state = make_tracking_env(library, 4, goals=expert.goals).reset()
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        acted = expert.actor()(state.clone())["action"]
    shown = expert.deployed(tuple(expert.goals))(state.clone())["action"]
    torch.testing.assert_close(shown, acted)
    # a keyframe stands in the place of every frame
    alone = state.exclude("goal_6", "goal_11")
    instead = state.clone().update({"goal_6": state["goal"], "goal_11": state["goal"]})
    keyframe = expert.deployed()(alone)["action"]
    torch.testing.assert_close(keyframe, expert.deployed(tuple(expert.goals))(instead)["action"])
    assert not torch.allclose(keyframe, shown)


def test_reference_velocity_is_what_the_damping_would_take(library):
    expert = untrained(ExpertConfig(action="reference_velocity", ahead=(1, 3)))
    state = make_tracking_env(library, 4, goals=expert.goals).reset()
    target = G1.default_joint_pos + G1.action_scale * expert.deployed(tuple(expert.goals))(state)["action"]
    first, later = state["goal", "joint_pos"], state["goal_3", "joint_pos"]
    torque = G1.stiffness * (target - first) - G1.damping * (later - first) / 0.04  # on the reference, at its velocity
    torch.testing.assert_close(torque, torch.zeros(4, 29), atol=1e-4, rtol=0)


def test_a_keyframe_has_no_velocity(library):
    expert = untrained(ExpertConfig(action="reference_velocity", ahead=(1, 2)))
    state = make_tracking_env(library, 4).reset()
    action = expert.deployed()(state)["action"]
    torch.testing.assert_close(G1.default_joint_pos + G1.action_scale * action, state["goal", "joint_pos"])


def test_reference_velocity_needs_two_frames():
    with pytest.raises(ConfigError, match=r"ahead is \(1,\), expected two frames for the action 'reference_velocity'"):
        Expert(G1, ExpertConfig(action="reference_velocity"))


def test_labels_of_an_expert_that_sees_several_frames(library):
    expert = Expert(G1, ExpertConfig(ahead=(1, 2)))
    assert expert.dense_goals == {"dense_goal": 1, "dense_goal_2": 2}
    keyframe = make_keyframe_env(library, 4, dense_goals=expert.dense_goals).reset()
    label = expert.deployed(tuple(expert.dense_goals))(keyframe)["action"]
    dense = keyframe.select("robot").update({"goal": keyframe["dense_goal"], "goal_2": keyframe["dense_goal_2"]})
    torch.testing.assert_close(label, expert.deployed(tuple(expert.goals))(dense)["action"])


def test_starting_from_an_expert_that_saw_less_changes_no_action(library):
    less, more = Expert(G1, ExpertConfig(hidden=(16,))), Expert(G1, ExpertConfig(hidden=(16,), ahead=(1, 2, 5)))
    state = make_tracking_env(library, 4, goals=more.goals).reset()
    less.normalizer.update(state)
    more.start_from(less)
    torch.testing.assert_close(more.deployed(tuple(more.goals))(state)["action"], less.deployed()(state)["action"])
    with pytest.raises(ValueError, match=r"it sees frames \(1, 2, 5\)"):
        less.start_from(more)


def test_starting_from_a_narrower_expert_changes_no_action(library):
    narrow, wide = (Expert(G1, ExpertConfig(hidden=hidden, ahead=(1, 2))) for hidden in ((16, 8), (24, 8)))
    state = make_tracking_env(library, 4, goals=wide.goals).reset()
    narrow.normalizer.update(state)
    wide.start_from(narrow)
    actions = (expert.deployed(tuple(expert.goals))(state)["action"] for expert in (narrow, wide))
    torch.testing.assert_close(*actions)
    with pytest.raises(ValueError, match=r"with hidden layers \(24, 8\); an expert that goes on from it has as many"):
        narrow.start_from(wide)


LED = ExpertConfig(ahead=(1, 2), lead=0.1, catch_up=0.5)


def test_a_lead_moves_what_is_seen_of_the_goals_and_nothing_else(library):
    led, plain = Expert(G1, LED), Expert(G1, ExpertConfig(ahead=(1, 2)))
    state = make_tracking_env(library, 4, goals=led.goals).reset()
    changed = (led.actor()(state.clone())["observation"] != plain.actor()(state.clone())["observation"]).any(0)
    moved = 2 * (3 + 3 * len(G1.keypoints))  # positions of root and keypoints in both frames
    assert changed.sum() == moved
    assert led.normalizer.in_keys == plain.normalizer.in_keys  # statistics are those of the goals as they are


def test_a_led_expert_labels_as_it_acts(library):
    expert = Expert(G1, LED)
    keyframe = make_keyframe_env(library, 4, dense_goals=expert.dense_goals).reset()
    label = expert.deployed(tuple(expert.dense_goals), out_key="expert_action")(keyframe)["expert_action"]
    dense = keyframe.select("robot").update({group: keyframe[f"dense_{group}"] for group in expert.goals})
    torch.testing.assert_close(label, expert.deployed(tuple(expert.goals))(dense)["action"])


def test_a_lead_needs_two_frames():
    with pytest.raises(ConfigError, match=r"ahead is \(1,\), expected two frames for a lead of 0.1 s"):
        Expert(G1, ExpertConfig(lead=0.1))


def test_an_expert_without_a_frame():
    with pytest.raises(ConfigError, match=r"ahead is \(\), expected .* at least one"):
        Expert(G1, ExpertConfig(ahead=()))


def test_limits_are_settings(library):
    state = make_tracking_env(library, 4).reset()
    expert = Expert(G1, ExpertConfig(residual_limit=0.25))
    torch.nn.init.constant_(expert.network[-1].bias, 99.0)
    target = G1.default_joint_pos + G1.action_scale * expert.deployed()(state.clone())["action"]
    torch.testing.assert_close(target - state["goal", "joint_pos"], (0.25 * G1.action_scale).expand(4, -1))
    shifts = []
    for limit in (0.1, 0.2):
        expert = Expert(G1, ExpertConfig(catch_up=1.0, catch_up_limit=limit))
        state["goal", "root_pos_b"] = torch.tensor([[3.0, 4.0, 0.0]]).expand(4, -1)
        moved = expert._observe(("goal",))[0](state.clone())["led_goal", "root_pos_b"]
        shifts.append((moved - state["goal", "root_pos_b"]).norm(dim=-1))
    torch.testing.assert_close(torch.stack(shifts), torch.tensor([[0.1] * 4, [0.2] * 4]))


def test_a_network_of_ones_own(library):
    expert = Expert(G1, ExpertConfig(action="default_offset"), network=torch.nn.LazyLinear(29))
    state = make_tracking_env(library, 4).reset()
    assert torch.equal(expert.deployed()(state.clone())["action"], expert.network(expert.actor()(state)["observation"]))


@pytest.mark.parametrize("ahead", [(6, 1), (1, 5, 5), (1, 5, 2)])
def test_frames_are_in_order_and_each_once(ahead):
    with pytest.raises(ConfigError, match=r"ahead is \(.*\), expected frames in ascending order, each once"):
        ExpertConfig(ahead=ahead, action="default_offset")
