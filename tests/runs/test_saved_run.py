import json
import math
from dataclasses import replace

import pytest
import torch
from safetensors.torch import load_file, save_file
from tensordict.nn import TensorDictModule

from plat.envs import make_keyframe_env
from plat.errors import CheckpointError
from plat.modules import (
    Expert,
    ExpertConfig,
    FinetunedPolicy,
    LatentNoisePolicy,
    LatentPolicy,
    LatentPolicyConfig,
    PlainPolicy,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.robots import G1, registry
from plat.runs import (
    Policy,
    SavedRun,
    load_dynamics,
    load_policy,
    policy_spec,
    register_policy,
    save_weights,
    write_json,
)
from plat.runs.policies import _KINDS, complete_spec
from plat.runs.trained_for import trained_for
from plat.spec.timing import Timing
from tests.modules.policies.test_student import SMALL

POLICIES = {
    "expert": lambda: Expert(G1, ExpertConfig(hidden=(16, 8), action="default_offset")),
    "latent": lambda: LatentPolicy(G1, SMALL),
    "plain": lambda: PlainPolicy(G1, SMALL),
    "residual_latent": lambda: ResidualLatentPolicy(LatentPolicy(G1, SMALL), RefinementConfig(hidden=(8,), alpha=0.3)),
    "residual_latent_noise": lambda: LatentNoisePolicy(LatentPolicy(G1, SMALL)),
    "residual_action": lambda: ResidualActionPolicy(LatentPolicy(G1, SMALL)),
    "finetuned": lambda: FinetunedPolicy(LatentPolicy(G1, SMALL)),
}


def save(run, policy) -> None:
    write_json(run / "config.json", {"policy": policy_spec(policy)})
    save_weights(run / "model.safetensors", policy)


@pytest.mark.parametrize("kind", POLICIES)
def test_every_policy_comes_back_as_it_was(tmp_path, library, kind):
    policy = POLICIES[kind]()
    save(tmp_path, policy)
    assert json.loads((tmp_path / "config.json").read_text())["policy"]["kind"] == kind
    loaded = load_policy(tmp_path)
    assert type(loaded) is type(policy)
    assert policy_spec(loaded) == policy_spec(policy)
    state = make_keyframe_env(library, 3).reset()
    assert torch.equal(loaded.deployed()(state.clone())["action"], policy.deployed()(state.clone())["action"])


def test_parameters_that_parts_share_are_saved(tmp_path):
    def tied() -> LatentPolicy:
        policy = LatentPolicy(G1, SMALL)
        policy.prior.codebook = policy.posterior.codebook = torch.nn.Parameter(torch.randn(4, 3))
        return policy

    policy, loaded = tied(), tied()
    save_weights(tmp_path / "model.safetensors", policy)
    loaded.load_state_dict(load_file(tmp_path / "model.safetensors"))
    assert torch.equal(loaded.prior.codebook, policy.prior.codebook)
    assert loaded.prior.codebook is loaded.posterior.codebook


def test_timing_travels_with_a_policy(tmp_path):
    timing = Timing(control_dt=0.01, max_steps=150, window=5)
    save(tmp_path, ResidualLatentPolicy(LatentPolicy(G1, replace(SMALL, timing=timing))))
    loaded = load_policy(tmp_path)
    assert loaded.timing == loaded.student.timing == timing


def test_a_policy_of_before_there_was_a_timing(run):
    config = json.loads((run / "config.json").read_text())
    del config["policy"]["config"]["timing"]
    (run / "config.json").write_text(json.dumps(config))
    assert load_policy(run).timing == Timing(control_dt=0.02, max_steps=50, window=3)


@pytest.fixture
def run(tmp_path):
    save(tmp_path, Expert(G1, ExpertConfig(hidden=(8,))))
    return tmp_path


def edit(run, **changes) -> None:
    config = json.loads((run / "config.json").read_text())
    config["policy"].update(changes)
    (run / "config.json").write_text(json.dumps(config))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robot": "h1"}, "robot 'h1' is unknown, expected one of \\['g1'"),
        (
            {"config": {"timing": {"max_steps": 0}}},
            "ExpertConfig.timing: .*max_steps is 0, expected a whole number from 1 to",
        ),
        ({"kind": "oracle"}, "unknown kind of policy 'oracle'"),
        ({"config": {"hidden": "wide"}}, "ExpertConfig.hidden"),
        ({"config": {"layers": 3}}, "config.json': ExpertConfig: unknown field 'layers', expected hidden, action,"),
        ({"config": {"hiden": [8]}}, "ExpertConfig: unknown field 'hiden', perhaps 'hidden'$"),
        (
            {"config": {"timing": {"max_step": 9}}},
            "ExpertConfig.timing: unknown field 'max_step', perhaps 'max_steps'$",
        ),
        ({"config": {"normalizer": {"size": 1}}}, "ExpertConfig.normalizer: unknown field 'size', expected eps, clip$"),
        ({"config": {"timing": {"control_dt": "0.02"}}}, "timing.control_dt is '0.02', expected a valid number$"),
        ({"config": {"timing": {"max_steps": 50.0}}}, "timing.max_steps is 50.0, expected a valid integer$"),
        ({"config": {"hidden": ["8"]}}, "ExpertConfig.hidden.0 is '8', expected a valid integer$"),
        ({"config": {"symmetric": 1}}, "ExpertConfig.symmetric is 1, expected a valid boolean$"),
        ({"config": {"timing": None}}, "ExpertConfig.timing is None, expected "),
        ({"trained_four": {}}, "config.json': policy: unknown field 'trained_four', perhaps 'trained_for'$"),
        ({"config": {"hidden": [16]}}, "has shape .* expected .* by the sizes in config.json"),
        ({"config": {"hidden": [8, 8]}}, "lacks \\['network.4.bias'"),
    ],
)
def test_a_config_that_does_not_fit(run, changes, message):
    edit(run, **changes)
    with pytest.raises(CheckpointError, match=message):
        load_policy(run)


@pytest.mark.parametrize("nested", [{"reach": {"sped": 1.0}}, {"reach": {"speed": "1.0"}}])
def test_a_student_within_a_policy_is_read_as_strictly(tmp_path, nested):
    save(tmp_path, ResidualLatentPolicy(LatentPolicy(G1, SMALL)))
    config = json.loads((tmp_path / "config.json").read_text())
    config["policy"]["student"]["config"].update(nested)
    write_json(tmp_path / "config.json", config)
    with pytest.raises(
        CheckpointError, match="LatentPolicyConfig.reach.*(perhaps 'speed'|'1.0', expected a valid number)"
    ):
        load_policy(tmp_path)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"version": 3}, "config.json': version is 3, this plat reads up to 1: update plat$"),
        ({"version": 0}, "config.json': version is 0, expected 1$"),
        ({"version": "1"}, "config.json': version is '1', expected 1$"),
        ({"version": None}, "config.json': version is None, expected 1$"),
        ({"format": "plat-keyframes"}, "config.json': format is 'plat-keyframes', expected 'plat-run'$"),
    ],
)
def test_a_run_of_another_format_or_version_is_refused(run, entries, message):
    config = json.loads((run / "config.json").read_text())
    assert SavedRun(run).kind == "expert"  # one that says neither
    write_json(run / "config.json", {"format": "plat-run", "version": 1, **config})
    assert SavedRun(run).kind == "expert"
    write_json(run / "config.json", {"format": "plat-run", "version": 1, **config, **entries})
    with pytest.raises(CheckpointError, match=message):
        load_policy(run)
    with pytest.raises(CheckpointError, match=message):
        load_dynamics(run, G1)


def registered(monkeypatch, name: str, **changes):
    """A robot of a name, whatever had it before."""
    robot = replace(G1, name=name, **changes)
    monkeypatch.setitem(registry._ROBOTS, name, robot)
    return robot


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"default_pose": {**G1.default_pose, "right_knee": 0.7}},
            "default_pose of 'right_knee' is 0.669, and 0.7 as robot 'mine' is now",
        ),
        ({"keypoints": G1.keypoints[:-1], "end_effectors": G1.feet}, "14 keypoints, and 13 as"),
        (
            {"keypoints": (G1.keypoints[0], *reversed(G1.keypoints[1:]))},
            r"keypoints\[1\] is 'left_hip_roll_link', and 'right_wrist_yaw_link' as",
        ),
    ],
)
def test_a_robot_that_changed_under_its_name_is_told(tmp_path, monkeypatch, changes, told):
    """Files keep the name of the robot alone: the policy would drive it to other poses, unnoticed."""
    save(tmp_path, LatentPolicy(registered(monkeypatch, "mine"), SMALL))
    assert load_policy(tmp_path).robot.name == "mine"
    registered(monkeypatch, "mine", root_height=0.77)  # nothing that the policy depends on
    assert load_policy(tmp_path).robot.name == "mine"
    registered(monkeypatch, "mine", **changes)
    expected = (
        rf"config.json': policy.trained_for: {told}.* give the changed robot another name, or remove 'trained_for'"
    )
    with pytest.raises(CheckpointError, match=expected):
        load_policy(tmp_path)
    config = json.loads((tmp_path / "config.json").read_text())
    del config["policy"]["trained_for"]  # as in runs of before
    write_json(tmp_path / "config.json", config)
    if "default_pose" in changes:
        assert load_policy(tmp_path).robot.name == "mine"


@pytest.mark.parametrize("kind", ["expert", "residual_latent"])
def test_motors_that_changed_under_a_robots_name_are_told(tmp_path, monkeypatch, kind):
    policy = POLICIES[kind]()
    save(tmp_path, policy)
    text = G1.asset_path.read_text()
    assert text.count('kp="99.09842778"') == 1
    (tmp_path / "stiff.xml").write_text(text.replace('kp="99.09842778"', 'kp="120"'))
    registered(monkeypatch, "g1", asset=str(tmp_path / "stiff.xml"))
    with pytest.raises(CheckpointError, match="stiffness of 'left_hip_roll' is 99.0984, and 120 as robot 'g1' is now"):
        load_policy(tmp_path)


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        (3, "trained_for is 3, expected an object"),
        ({}, "trained_for.joints is None, expected a list of names"),
        ({**trained_for(G1), "damping": ["soft"]}, r"trained_for.damping is \['soft'\], expected a list of numbers"),
        ({**trained_for(G1), "damping": [10**400]}, r"trained_for.damping is \[10*.*, expected a list of numbers"),
        ({**trained_for(G1), "damping": [1.0]}, "damping of 1 joint, and of 29 as robot 'g1' is now"),
        ({**trained_for(G1), "joints": ["knee"] * 29}, r"joints\[0\] is 'knee', and 'left_hip_pitch' as robot"),
    ],
)
def test_what_a_policy_was_trained_for_is_damaged(run, entry, told):
    edit(run, trained_for=entry)
    with pytest.raises(CheckpointError, match=f"config.json': policy.{told}|policy.trained_for: {told}"):
        load_policy(run)


def test_the_student_of_a_policy_does_not_say_it_twice():
    spec = policy_spec(POLICIES["residual_latent"]())
    assert "trained_for" in spec
    assert "trained_for" not in spec["student"]


def test_missing_files(tmp_path, run):
    with pytest.raises(
        CheckpointError, match="nowhere': no such run directory; weights that come with plat: dagger-g1"
    ):
        load_policy(tmp_path / "nowhere")
    (run / "model.safetensors").unlink()
    with pytest.raises(CheckpointError, match="model.safetensors'?: no such file; has the run saved"):
        load_policy(run)


def test_missing_and_unknown_weights(run):
    weights = load_file(run / "model.safetensors")
    weights["extra"] = weights.pop("normalizer.mean")
    save_file(weights, run / "model.safetensors")
    with pytest.raises(CheckpointError, match="lacks \\['normalizer.mean'\\] and has the unknown \\['extra'\\]"):
        load_policy(run)


@pytest.mark.parametrize("file", ["config.json", "model.safetensors"])
@pytest.mark.parametrize("keep", [0, 7, 100])
def test_truncated_files(run, file, keep):
    (run / file).write_bytes((run / file).read_bytes()[:keep])
    with pytest.raises(CheckpointError, match=f"{file}'?: not a readable"):
        load_policy(run)


def test_config_without_a_policy(run):
    (run / "config.json").write_text("{}")
    with pytest.raises(CheckpointError, match="'policy' is not an object with"):
        load_policy(run)
    (run / "config.json").write_text("[1]")
    with pytest.raises(CheckpointError, match="holds a list, expected an object"):
        load_policy(run)


def test_a_write_that_fails_leaves_the_old_file(run, monkeypatch):
    before = (run / "model.safetensors").read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("plat.runs.saved_run.save_file", full)
    with pytest.raises(CheckpointError, match="model.safetensors' could not be written .*No space left.* intact"):
        save_weights(run / "model.safetensors", Expert(G1))
    assert (run / "model.safetensors").read_bytes() == before
    assert sorted(path.name for path in run.iterdir()) == ["config.json", "model.safetensors"]


class OwnStudent(LatentPolicy):
    """Of a user, with a layer more than the config says."""

    def __init__(self, robot, config=None):
        super().__init__(robot, config)
        self.more = torch.nn.Linear(2, 2)


class OwnRefinement(ResidualLatentPolicy):
    """Of a user."""


def test_policies_of_ones_own(tmp_path, monkeypatch):
    monkeypatch.setattr("plat.runs.policies._KINDS", dict(_KINDS))
    policy = OwnRefinement(OwnStudent(G1, SMALL), RefinementConfig(alpha=0.3))
    with pytest.raises(CheckpointError, match="OwnRefinement is none of .*register_policy adds one"):
        policy_spec(policy)
    register_policy("own_student", OwnStudent, LatentPolicyConfig)
    register_policy("own_refinement", OwnRefinement, RefinementConfig)
    register_policy("own_refinement", OwnRefinement, RefinementConfig)  # twice is once
    save(tmp_path, policy)
    loaded = load_policy(tmp_path)
    assert type(loaded) is OwnRefinement
    assert type(loaded.student) is OwnStudent
    assert loaded.config.alpha == 0.3
    assert torch.equal(loaded.student.more.weight, policy.student.more.weight)
    with pytest.raises(ValueError, match="'own_student' is a OwnStudent already"):
        register_policy("own_student", OwnRefinement, RefinementConfig)


class LazyPrior(LatentPolicy):
    """Of a user: a prior whose layer learns its size from its first input."""

    def __init__(self, robot, config=None):
        prior = TensorDictModule(torch.nn.LazyLinear(SMALL.latent_size), ["hidden"], [("prior", "loc")])
        super().__init__(robot, config, prior=prior)


def test_lazy_layers_are_loaded_and_refined(tmp_path, monkeypatch, library):
    monkeypatch.setattr("plat.runs.policies._KINDS", dict(_KINDS))
    register_policy("lazy_prior", LazyPrior, LatentPolicyConfig)
    policy, state = LazyPrior(G1, SMALL), make_keyframe_env(library, 2).reset()
    action = policy.deployed()(state.clone())["action"]
    save(tmp_path / "student", policy)
    assert torch.equal(load_policy(tmp_path / "student").deployed()(state.clone())["action"], action)
    save(tmp_path / "refined", ResidualLatentPolicy(policy))
    assert load_policy(tmp_path / "refined").deployed()(state.clone())["action"].shape == action.shape


def test_a_kind_that_nobody_registered(run):
    edit(run, kind="own")
    with pytest.raises(CheckpointError, match="config.json': unknown kind of policy 'own', .*register_policy"):
        load_policy(run)


def test_other_modules_are_refused():
    with pytest.raises(CheckpointError, match="Linear is none of the policies"):
        policy_spec(torch.nn.Linear(1, 1))


def test_a_description_is_completed_and_draws_nothing(run):
    spec = json.loads((run / "config.json").read_text())["policy"]
    whole = json.loads(json.dumps(spec))
    del spec["config"]["init_std"], spec["config"]["ahead"]
    state = torch.random.get_rng_state()
    assert complete_spec(spec, run / "config.json") == whole
    assert torch.equal(torch.random.get_rng_state(), state)
    with pytest.raises(CheckpointError, match="config.json': 'policy' is not an object"):
        complete_spec(None, run / "config.json")


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_weights_that_are_not_finite(run, value):
    weights = load_file(run / "model.safetensors")
    weights["network.0.weight"][3, 4] = value
    save_file(weights, run / "model.safetensors")
    with pytest.raises(CheckpointError, match="'network.0.weight' holds NaN or infinity"):
        load_policy(run)


def test_what_a_run_says_of_itself(run):
    assert isinstance(load_policy(run), Policy)
    empty = SavedRun(run)
    assert (empty.kind, empty.robot, empty.recipe, empty.settings, empty.steps) == ("expert", "g1", None, {}, 0)
    config = json.loads((run / "config.json").read_text())
    recipe = {"name": "expert", "settings": {"motions": ["a"]}}
    write_json(run / "config.json", {**config, "recipe": recipe, "finished": {"steps": 7, "seconds": 1.5}})
    saved = SavedRun(run)
    assert (empty.seconds, saved.seconds) == (0.0, 1.5)
    assert (saved.name, saved.recipe, saved.settings, saved.steps) == (run.name, "expert", {"motions": ["a"]}, 7)


def test_files_are_read_once(run):
    saved = SavedRun(run)
    (run / "config.json").unlink()
    assert saved.policy().config.hidden == (8,)
    (run / "evaluation.csv").write_text(TABLE)
    scores = saved.scores
    (run / "evaluation.csv").unlink()
    assert saved.scores is scores is not None


TABLE = """policy,horizon,seeds,metric,value,low,high
chaser,long,1,tks,99.5,99.25,99.75
chaser,long,1,mpjpe,0.1,0.09,0.11
"""
OTHERS = TABLE + "other,long,1,tks,1,1,1\n"


def named(run, name: str, **settings: str) -> SavedRun:
    config = json.loads((run / "config.json").read_text())
    write_json(run / "config.json", {**config, "recipe": {"name": "refine", "settings": settings}})
    return SavedRun(run.rename(run.parent / name))


@pytest.fixture
def chaser(tmp_path):
    run = tmp_path / "runs" / "chaser"
    save(run, Expert(G1, ExpertConfig(hidden=(8,))))
    return run


@pytest.mark.parametrize("place", [".", ".."])
@pytest.mark.parametrize(
    ("table", "name", "settings", "found"),
    [
        (OTHERS, "chaser", {}, [99.5, 0.1]),
        (OTHERS, "renamed", {"out": "runs/chaser"}, [99.5, 0.1]),
        (OTHERS, "renamed", {}, None),
        (OTHERS, "other", {"out": "runs/chaser"}, [1.0]),
    ],
)
def test_scores_are_told_by_name(chaser, place, table, name, settings, found):
    (chaser / place / "evaluation.csv").write_text(table)
    scores = named(chaser, name, **settings).scores
    assert (scores and [score.value for score in scores]) == found


def test_a_table_of_its_own_needs_no_name_and_one_beside_it_does(chaser):
    (chaser.parent / "evaluation.csv").write_text(TABLE)
    assert named(chaser, "renamed").scores is None
    (chaser.parent / "renamed" / "evaluation.csv").write_text(TABLE)
    assert [score.metric for score in SavedRun(chaser.parent / "renamed").scores] == ["tks", "mpjpe"]


def test_scores_of_the_run_that_has_the_original_name_now_are_not_those_of_the_renamed_one(chaser):
    renamed = named(chaser, "renamed", out="runs/chaser")
    save(chaser, Expert(G1, ExpertConfig(hidden=(8,))))
    (chaser.parent / "evaluation.csv").write_text(OTHERS)
    assert renamed.scores is None
    assert [score.value for score in SavedRun(chaser).scores] == [99.5, 0.1]


def test_scores_of_other_than_the_usual_conditions_are_left_out(chaser):
    lines = TABLE.splitlines()
    table = [lines[0] + ",conditions", lines[1] + ",partial keyframes (hands)", lines[2] + ","]
    (chaser / "evaluation.csv").write_text("\n".join(table))
    assert [score.metric for score in SavedRun(chaser).scores] == ["mpjpe"]
    (chaser / "evaluation.csv").write_text("\n".join(table[:2]))
    assert SavedRun(chaser).scores is None


def test_no_scores(chaser):
    assert SavedRun(chaser).scores is None
    (chaser / "evaluation.csv").write_text("")
    assert SavedRun(chaser).scores is None


@pytest.mark.parametrize("table", [TABLE.replace("99.5", "many"), "a,b\n1,2\n"])
def test_a_table_that_is_none(chaser, table):
    (chaser / "evaluation.csv").write_text(table)
    with pytest.raises(CheckpointError, match="evaluation.csv': not a table of plat evaluate --csv"):
        SavedRun(chaser).scores  # noqa: B018


def test_a_config_that_makes_no_sense(run):
    edit(run, config={"hidden": [8], "action": "reference_velocity"})
    with pytest.raises(CheckpointError, match="config.json': ExpertConfig: ahead .* expected two frames"):
        load_policy(run)


class OwnParts(torch.nn.Module):
    """Of a user, whose constructor takes no config."""

    def __init__(self, robot, linear):
        super().__init__()
        self.robot, self.config, self.linear = robot, LatentPolicyConfig(), linear

    @classmethod
    def build(cls, robot, config):
        return cls(robot, torch.nn.Linear(2, 2))


class OnStudent(OwnParts):
    """Of a user, on a student, and no refinement of plat's."""

    def __init__(self, student):
        super().__init__(student.robot, torch.nn.Linear(1, 1))
        self.student = student

    @classmethod
    def build(cls, student, config):
        return cls(student)


def test_classes_with_a_constructor_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setattr("plat.runs.policies._KINDS", dict(_KINDS))
    register_policy("own_parts", OwnParts, LatentPolicyConfig)
    register_policy("on_student", OnStudent, LatentPolicyConfig, base="student")
    policy = OnStudent(OwnParts(G1, torch.nn.Linear(2, 2)))
    save(tmp_path, policy)
    assert torch.equal(load_policy(tmp_path).student.linear.weight, policy.student.linear.weight)


def test_what_is_no_run_is_called_what_it_is(tmp_path):
    (tmp_path / "bundle").mkdir()
    (tmp_path / "bundle" / "bundle.json").write_text("{}")
    with pytest.raises(CheckpointError, match="this is a bundle: give the run that it was exported from"):
        SavedRun(tmp_path / "bundle").policy  # noqa: B018
    (tmp_path / "model.safetensors").write_bytes(b"")
    with pytest.raises(CheckpointError, match=r"model.safetensors': is a file, expected a run directory"):
        SavedRun(tmp_path / "model.safetensors").policy  # noqa: B018
