from dataclasses import replace

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from plat.deploy import ObservationBuilder
from plat.errors import ConfigError, ObservationError, RobotError
from plat.export import JointTargetNetwork
from plat.modules import (
    BothSides,
    Expert,
    ExpertConfig,
    FinetunedPolicy,
    LatentNoisePolicy,
    LatentPolicy,
    LatentPolicyConfig,
    MeanOfSides,
    PlainPolicy,
    PlainPolicyConfig,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
    WalkingReach,
    take_over,
)
from plat.modules.symmetry import mirrored_columns
from plat.motions import MotionClip, mirror_motion
from plat.robots import G1, joint_symmetry
from plat.spec.observation import OBSERVATION, Entry, observation_widths, observing, student_keys
from plat.spec.parts import Parts
from tests.deploy.robots import SomePose, describe_g1, random_qpos, state_at

ALSO = ("parts", "clock")
SMALL = PlainPolicyConfig(
    backbone=(16,), hidden_size=16, decoder=(16,), also=ALSO, reach=WalkingReach(), symmetric=True
)
PARTNER, SIGN = (torch.from_numpy(part) for part in joint_symmetry(G1))


def mirrored_pose(qpos):
    return mirror_motion(MotionClip("pose", qpos[None], 1.0)).qpos[0]


def mirrored_velocity(qvel):
    return np.concatenate((qvel[:3] * [1, -1, 1], qvel[3:6] * [-1, 1, -1], qvel[6:][PARTNER] * SIGN.numpy()))


def test_a_mirrored_robot_observes_the_mirrored_columns():
    build = ObservationBuilder(describe_g1(), 50, ALSO)
    column, sign = mirrored_columns(student_keys(ALSO), G1)
    random = np.random.default_rng(0)
    left, right = (
        Parts.only(G1, joints=[f"{side}_knee"], bodies=[f"{side}_wrist_yaw_link"], root=["height"])
        for side in ("left", "right")
    )
    for qpos, target in random_qpos(20).reshape(10, 2, 36):
        qvel, action = random.standard_normal(35), random.standard_normal(29)
        for commands, other in ((None, None), (left, right)):
            pose, image = SomePose(target), SomePose(mirrored_pose(target))
            pose.commands, image.commands = commands, other
            seen = build(state_at(qpos, qvel), pose, 8, action)
            mirrored = build(
                state_at(mirrored_pose(qpos), mirrored_velocity(qvel)), image, 8, action[PARTNER] * SIGN.numpy()
            )
            # the links of the model itself are symmetric to a fraction of a millimeter
            np.testing.assert_allclose(mirrored, seen[column] * sign.numpy(), atol=2e-3)


def test_the_mirror_image_of_the_mirror_image_is_the_observation():
    column, sign = mirrored_columns(student_keys(ALSO), G1)
    torch.testing.assert_close(column[column], torch.arange(len(column)))
    torch.testing.assert_close(sign * sign[column], torch.ones(len(column)))


EXPERT = ExpertConfig(hidden=(16,), ahead=(1, 2), action="reference_velocity", lead=0.1, catch_up=2.0, symmetric=True)


LATENT = LatentPolicyConfig(
    backbone=(16,), hidden_size=16, decoder=(16,), latent_size=4, reach=WalkingReach(), symmetric=True
)


def refined(kind):
    """Constructor of a refinement, with a residual that does something, from its student's config."""

    def build(robot, config):
        policy = kind(LatentPolicy(robot, config), RefinementConfig(hidden=(16,), lead=0.1))
        for weight in policy.parameters():
            torch.nn.init.normal_(weight, std=0.3)
        return policy

    return build


@pytest.mark.parametrize(
    ("build", "config"),
    [
        (PlainPolicy, SMALL),
        (Expert, EXPERT),
        (LatentPolicy, LATENT),
        *(
            (refined(kind), LATENT)
            for kind in (ResidualLatentPolicy, LatentNoisePolicy, ResidualActionPolicy, FinetunedPolicy)
        ),
    ],
)
def test_a_symmetric_policy_answers_the_mirror_image_with_the_mirrored_action(build, config):
    # through what is exported, which takes the observation as one vector
    policy = build(G1, config)
    network = JointTargetNetwork(policy)
    column, sign = mirrored_columns(network.keys, G1)
    observation = torch.randn(5, network.num_features)
    target, image = network(observation), network(observation[:, column] * sign)
    torch.testing.assert_close(image, target[:, PARTNER] * SIGN.float(), atol=1e-5, rtol=1e-5)
    plain = build(G1, replace(config, symmetric=False))
    plain.load_state_dict(policy.state_dict())
    alone = JointTargetNetwork(plain)
    expected = 0.5 * (alone(observation) + alone(observation[:, column] * sign)[:, PARTNER] * SIGN.float())
    torch.testing.assert_close(target, expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize(
    ("build", "config"), [(PlainPolicy, SMALL), (LatentPolicy, LATENT), (refined(ResidualLatentPolicy), LATENT)]
)
def test_a_symmetric_policy_acts_where_its_weights_are(build, config):
    # on the device without memory, which refuses tensors of others as a GPU does
    deployed = build(G1, config).to("meta").deployed()
    keys = student_keys(config.also)
    widths = zip(keys, observation_widths(keys, G1), strict=True)
    observed = TensorDict({key: torch.zeros(3, width, device="meta") for key, width in widths}, [3], device="meta")
    assert deployed(observed)["action"].device.type == "meta"


def test_a_symmetric_student_takes_over_the_weights_of_one_that_is_not():
    trained = PlainPolicy(G1, replace(SMALL, symmetric=False))
    student = PlainPolicy(G1, SMALL)
    take_over(student, trained)
    for name, value in trained.state_dict().items():
        torch.testing.assert_close(student.state_dict()[name], value)


def test_a_symmetric_student_with_a_latent_learns_as_one_that_is_not():
    policy = LatentPolicy(G1, LATENT)
    plain = LatentPolicy(G1, replace(LATENT, symmetric=False))
    assert policy.training_graph().in_keys == plain.training_graph().in_keys
    assert [str(module) for module in policy.sampled()] == [str(module) for module in plain.sampled()]


def test_an_entry_that_does_not_say_how_it_is_mirrored_is_refused():
    with (
        observing(OBSERVATION.with_entry("goal", Entry("toy", "m", "world", size=1))),
        pytest.raises(ConfigError, match=r"how entry 'toy' is mirrored \(Entry.mirrored\)"),
    ):
        PlainPolicy(G1, SMALL).deployed()


def test_entries_of_another_size_are_named():
    with pytest.raises(ObservationError, match="symmetry: entry .*gravity_b.* has shape"):
        BothSides(G1, [("robot", "gravity_b")])(TensorDict({"robot": {"gravity_b": torch.zeros(2, 4)}}, [2]))


def test_a_robot_that_stands_crooked_is_refused():
    pose = {**G1.default_pose, "left_knee": 0.9}
    with pytest.raises(RobotError, match="'crooked': its default pose is not symmetric"):
        MeanOfSides(replace(G1, name="crooked", default_pose=pose))
