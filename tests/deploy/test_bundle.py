import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from plat.deploy import Bundle, BundleScore, PolicyFacts, TrainingFacts
from plat.errors import BundleError
from plat.spec.timing import Timing
from tests.deploy.robots import describe_g1


@pytest.fixture(scope="module")
def bundle() -> Bundle:
    return Bundle(
        robot=describe_g1(),
        timing=Timing(window=4),
        policy=PolicyFacts("residual_latent", 32, 0.1 + 0.2),
        training=TrainingFacts("plat", "refine", "0.1.0", None, None),
        scores=(BundleScore("long", "tks", 99.1, 98.0, 100.0),),
    )


def test_reading_gives_back_what_was_written(bundle):
    for original in (bundle, replace(bundle, scores=None), replace(bundle, network_sha256="0f" * 32)):
        copy = Bundle.from_json(original.to_json(), "here")
        assert (copy.timing, copy.policy, copy.training, copy.scores, copy.terms, copy.network_sha256) == (
            original.timing,
            original.policy,
            original.training,
            original.scores,
            original.terms,
            original.network_sha256,
        )
        ours, theirs = asdict(copy.robot), asdict(original.robot)
        assert set(ours) == set(theirs)
        for name, value in theirs.items():
            np.testing.assert_array_equal(ours[name], value)


def test_a_bundle_that_does_not_say_its_window(bundle):
    content = json.loads(bundle.to_json())
    del content["command"]["window"]
    assert Bundle.from_json(json.dumps(content), "here").timing == Timing(window=3)


def test_a_bundle_that_does_not_say_its_mass(bundle):
    content = json.loads(bundle.to_json())
    assert content["robot"].pop("mass") == pytest.approx(33.3, abs=0.1)
    assert Bundle.from_json(json.dumps(content), "here").robot.mass is None


def test_lists_of_numbers_are_on_one_line_and_unchanged(bundle):
    text = bundle.to_json()
    assert '"default_joint_pos": [-0.312' in text
    names = ("a  b", "c]\n[", 'd"', *bundle.robot.joint_names[3:])
    odd = replace(bundle, robot=replace(bundle.robot, joint_names=names))
    assert Bundle.from_json(odd.to_json(), "here").robot.joint_names == names


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "plat-run"}, "format: is 'plat-run', expected 'plat-bundle'"),
        ({"version": 2}, "version: is 2, this plat reads up to 1: update plat"),
        ({"version": 0}, "version: is 0, expected 1"),
        ({"quaternion_order": "xyzw"}, "quaternion_order: is 'xyzw', expected 'wxyz'"),
        ({"control_dt": 0}, "control_dt: is 0.0, expected 0.001 to 1 seconds"),
        ({"control_dt": 2}, "control_dt: is 2.0, expected 0.001 to 1 seconds"),
        ({"control_dt": None}, "control_dt: is None, expected a finite number"),
        ({"control_dt": 10**400}, r"control_dt: is 1000.*000, expected a finite number"),
        ({"version": True}, "version: is True, expected 1"),
        ({"command.max_steps": 10**400}, "command.max_steps: is 1000.*000, expected at least 1 and at most 10000"),
        ({"command.max_steps": 20_000}, "command.max_steps: is 20000, expected at least 1 and at most 10000"),
        ({"command.max_steps": 0}, "command.max_steps: is 0, expected at least 1"),
        ({"command.window": 0}, "command.window: is 0, expected at least 1"),
        ({"command.window": "3"}, "command.window: is '3', expected a whole number"),
        ({"command": 3}, "command is a int, expected an object"),
        ({"robot.stiffness": [1.0]}, r"robot.stiffness: has shape \(1,\), expected \(29,\)"),
        ({"robot.stiffness": ["a"] * 29}, "robot.stiffness: expected numbers only"),
        ({"robot.stiffness": ["1.5"] * 29}, "robot.stiffness: expected numbers only"),
        ({"robot.stiffness": [True] * 29}, "robot.stiffness: expected numbers only"),
        ({"robot.stiffness": [10**400] * 29}, "robot.stiffness: expected numbers only"),
        ({"robot.stiffness.3": -1.0}, r"robot.stiffness\[3\]: is -1, expected at least 0"),
        ({"robot.damping.0": -0.5}, r"robot.damping\[0\]: is -0.5, expected at least 0"),
        ({"robot.effort_limit.28": -80}, r"robot.effort_limit\[28\]: is -80, expected at least 0"),
        ({"robot.action_scale.1": 0}, r"robot.action_scale\[1\]: is 0, expected more than 0"),
        ({"robot.action_scale.1": -0.3}, r"robot.action_scale\[1\]: is -0.3, expected more than 0"),
        ({"robot.action_scale.1": float("inf")}, "robot.action_scale: expected finite numbers"),
        ({"robot.joint_range.2": [0.5, -0.5]}, r"robot.joint_range\[2\]: from 0.5 to -0.5, expected lower"),
        ({"robot.root_height": -0.76}, "robot.root_height: is -0.76, expected a positive number of meters"),
        ({"robot.bodies.1.quat": [2.0, 0, 0, 0]}, r"robot.bodies\[1\].quat: has length 2, expected 1"),
        ({"robot.bodies.1.axis": [0, 0, 0]}, r"robot.bodies\[1\].axis: has length 0, expected 1"),
        ({"robot.mass": 0}, "robot.mass: is 0, expected a positive number of kilograms"),
        ({"robot.mass": "35"}, "robot.mass: is '35', expected a finite number"),
        ({"network_sha256": 5}, "network_sha256: is 5, expected a text"),
        ({"robot.damping": [float("nan")] * 29}, "robot.damping: expected finite numbers"),
        ({"robot.joint_names": ["a", "a"]}, "robot.joint_names: expected a list of different names"),
        ({"robot.keypoints": ["tail"]}, "robot.keypoints: 'tail' is not the name of a body"),
        ({"robot.keypoints": ["torso_link"]}, "robot.keypoints: the first is 'torso_link', expected the root 'pelvis'"),
        ({"robot.bodies": []}, "robot.bodies: is empty"),
        ({"robot.bodies.1.parent": 1}, r"robot.bodies\[1\].parent: is 1, expected the index of an earlier body"),
        ({"robot.bodies.0.parent": 0}, r"robot.bodies\[0\].parent: is 0"),
        ({"robot.bodies.2.joint": 29}, r"robot.bodies\[2\].joint: is 29, expected the index of a joint or -1"),
        ({"observation.terms.1.stop": 57}, r"observation.terms: \('robot.joint_vel', 29, 57\), expected"),
        ({"robot.feet.0.body": "paw"}, r"robot.feet\[0\].body: 'paw' is not the name of a body"),
        ({"robot.feet.1.soles": [[0.1, 0.2]]}, r"robot.feet\[1\].soles: has shape \(1, 2\), expected \(1, 3\)"),
        ({"robot.feet.1.soles": 3}, r"robot.feet\[1\].soles: is 3, expected a list"),
        ({"robot.feet": [7]}, r"robot.feet\[0\] is a int, expected an object"),
        ({"robot.feet": 7}, "robot.feet: is 7, expected a list"),
        ({"action.name": "torque"}, "action.name: is 'torque', expected 'joint_position_target'"),
        ({"policy.latent_size": "big"}, "policy.latent_size: is 'big', expected a whole number"),
        ({"training.run": 3}, "training.run: is 3, expected a text"),
        ({"scores": [{"horizon": "long", "metric": "tks"}]}, r"scores\[0\].value: is missing"),
    ],
)
def test_what_is_wrong_is_named(bundle, change, message):
    content = json.loads(bundle.to_json())
    ((path, value),) = change.items()
    *parents, field = [int(key) if key.isdigit() else key for key in path.split(".")]
    entry = content
    for key in parents:
        entry = entry[key]
    entry[field] = value
    with pytest.raises(BundleError, match=f"here: {message}"):
        Bundle.from_json(json.dumps(content), "here")


def test_every_field_is_asked_for(bundle):
    for field in json.loads(bundle.to_json()):
        content = json.loads(bundle.to_json())
        del content[field]
        if field == "scores":  # absent is as good as null
            assert Bundle.from_json(json.dumps(content), "here").scores is None
            continue
        with pytest.raises(BundleError, match=f"here: {field}"):
            Bundle.from_json(json.dumps(content), "here")


def test_a_term_too_few(bundle):
    content = json.loads(bundle.to_json())
    content["observation"]["terms"].pop()
    with pytest.raises(BundleError, match="observation.terms: 10 of them, expected 11"):
        Bundle.from_json(json.dumps(content), "here")


@pytest.mark.parametrize("text", ["", "{", "[1]", "3"])
def test_what_is_no_object(text):
    with pytest.raises(BundleError, match="here: "):
        Bundle.from_json(text, "here")
