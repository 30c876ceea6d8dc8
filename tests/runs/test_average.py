import errno
import json
import math
import pathlib
import shutil
import subprocess
import sys
from dataclasses import replace

import pytest
import torch
from torch import nn

from plat.cli import main
from plat.errors import CheckpointError, ConfigError, OutputError
from plat.modules import (
    Expert,
    ExpertConfig,
    LatentPolicy,
    PlainPolicy,
    PlainPolicyConfig,
    RefinementConfig,
    ResidualLatentPolicy,
)
from plat.modules.settings import NormalizerConfig, WalkingReach
from plat.robots import G1
from plat.runs import SavedRun, average_runs, average_weights, policy_spec, save_weights, write_json
from plat.runs.lineage import made_by, parents, trained_on
from plat.spec.timing import Timing
from plat.tasks import TimedKeyframes, TimedKeyframesConfig
from tests.modules.policies.test_student import SMALL


def saved(folder, hidden=16):
    folder.mkdir(parents=True)
    policy = PlainPolicy(G1, PlainPolicyConfig(backbone=(hidden,), hidden_size=8, decoder=(8,)))
    nn.init.normal_(policy.state_dict()["normalizer.mean"])
    write_json(folder / "config.json", {"policy": policy_spec(policy), "finished": {"steps": hidden}})
    save_weights(folder / "model.safetensors", policy)
    return policy.state_dict()


def test_the_mean_of_two_runs(tmp_path):
    one, other = saved(tmp_path / "one"), saved(tmp_path / "other")
    (tmp_path / "other" / "dynamics.safetensors").write_bytes(b"a model")
    run = average_runs([tmp_path / "one", tmp_path / "other"], tmp_path / "mean", (1, 3))
    for name, tensor in run.policy().state_dict().items():
        expected = 0.25 * one[name] + 0.75 * other[name] if tensor.is_floating_point() else other[name]
        torch.testing.assert_close(tensor, expected)
    assert [(part["run"], part["share"]) for part in run.config["average"]] == [
        (str(tmp_path / "one"), 0.25),
        (str(tmp_path / "other"), 0.75),
    ]
    assert (tmp_path / "mean" / "dynamics.safetensors").read_bytes() == b"a model"


def test_the_command(tmp_path, capsys):
    saved(tmp_path / "one"), saved(tmp_path / "other")
    main(["average", str(tmp_path / "one"), str(tmp_path / "other"), "--out", str(tmp_path / "mean")])
    assert "model.safetensors" in capsys.readouterr().out
    assert json.loads((tmp_path / "mean" / "config.json").read_text())["average"][0]["share"] == 0.5


def test_the_mean_of_a_run_with_itself_is_the_run(tmp_path):
    weights = saved(tmp_path / "one")
    run = average_runs([tmp_path / "one"] * 3, tmp_path / "mean")
    assert all(tensor.equal(weights[name]) for name, tensor in run.policy().state_dict().items())


@pytest.mark.parametrize("scale", [1e308, 5e-324, 1e-3])
def test_shares_count_by_their_ratio(tmp_path, scale):
    saved(tmp_path / "one")
    run = average_runs([tmp_path / "one"] * 2, tmp_path / "mean", (scale, scale))
    assert [part["share"] for part in run.config["average"]] == [0.5, 0.5]


def test_what_cannot_be_averaged(tmp_path):
    saved(tmp_path / "one"), saved(tmp_path / "narrower", hidden=8)
    out = tmp_path / "mean"
    with pytest.raises(ConfigError, match="runs: 1, expected two or more to average; with one, --symmetric .* --reach"):
        average_runs([tmp_path / "one"], out)
    with pytest.raises(ConfigError, match="runs: 0, expected two or more to average$"):
        average_runs([], out)
    with pytest.raises(ConfigError, match="--shares: 3 numbers, expected 2"):
        average_runs([tmp_path / "one", tmp_path / "one"], out, (1, 1, 1))
    for shares in ((1, 0), (1, -1), (-1, 2), (0.5, math.nan), (1, math.inf), (1, "1"), (1, True)):
        with pytest.raises(ConfigError, match=r"--shares is ('1'|[\w.-]+), expected a number above 0$"):
            average_runs([tmp_path / "one", tmp_path / "one"], out, shares)
    with pytest.raises(CheckpointError, match=r"the trained policy has \(16, \d+\) for backbone"):
        average_runs([tmp_path / "one", tmp_path / "narrower"], out)
    with pytest.raises(CheckpointError, match="holds a 'residual_latent' policy"):
        average_runs(["plat-g1", tmp_path / "one"], out)
    assert not out.exists()
    with pytest.raises(CheckpointError, match="already holds a run"):
        average_runs([tmp_path / "one", tmp_path / "one"], tmp_path / "narrower")


def save(folder, policy) -> None:
    write_json(folder / "config.json", {"policy": policy_spec(policy)})
    save_weights(folder / "model.safetensors", policy)


EXPERT = ExpertConfig(hidden=(8,), ahead=(1, 2))


def plain(**fields) -> PlainPolicy:
    return PlainPolicy(G1, PlainPolicyConfig(backbone=(8,), hidden_size=8, decoder=(8,), **fields))


def residual(alpha: float, **fields) -> ResidualLatentPolicy:
    return ResidualLatentPolicy(LatentPolicy(G1, replace(SMALL, **fields)), RefinementConfig(hidden=(8,), alpha=alpha))


@pytest.mark.parametrize(
    ("one", "last", "field"),
    [
        (lambda: Expert(G1, replace(EXPERT, action="default_offset")), lambda: Expert(G1, EXPERT), "config.action"),
        (lambda: Expert(G1, replace(EXPERT, ahead=(1, 5))), lambda: Expert(G1, EXPERT), "config.ahead"),
        (lambda: Expert(G1, replace(EXPERT, lead=0.1)), lambda: Expert(G1, EXPERT), "config.lead"),
        (lambda: residual(0.3), lambda: residual(0.5), "config.alpha"),
        (lambda: residual(0.5, reach=WalkingReach()), lambda: residual(0.5), "student.config.reach"),
        (lambda: residual(0.5, timing=Timing(max_steps=99)), lambda: residual(0.5), "student.config.timing.max_steps"),
        (lambda: plain(timing=Timing(control_dt=0.01)), plain, "config.timing.control_dt"),
        (lambda: plain(reach=WalkingReach()), plain, "config.reach"),
        (lambda: plain(normalizer=NormalizerConfig(clip=5.0)), plain, "config.normalizer.clip"),
    ],
)
def test_weights_that_mean_different_things_are_refused(tmp_path, one, last, field):
    save(tmp_path / "one", one()), save(tmp_path / "last", last())
    with pytest.raises(CheckpointError, match=rf"^'.*one': policy.{field} is .*, expected .* as in '.*last': weights"):
        average_runs([tmp_path / "one", tmp_path / "last", tmp_path / "last"], tmp_path / "mean")
    assert not (tmp_path / "mean").exists()


@pytest.mark.parametrize(
    ("one", "last"),
    [
        (lambda: Expert(G1, replace(EXPERT, init_std=0.1, min_std=0.01)), lambda: Expert(G1, EXPERT)),
        (plain, lambda: plain(also=("clock",), timing=Timing(max_steps=150))),
        (plain, lambda: plain(reach=WalkingReach())),  # it was trained on from the other one
        (plain, lambda: plain(symmetric=True)),
    ],
)
def test_differences_without_harm(tmp_path, one, last):
    save(tmp_path / "one", one()), save(tmp_path / "last", last())
    average_runs([tmp_path / "one", tmp_path / "last"], tmp_path / "mean")


def test_a_run_is_made_symmetric(tmp_path):
    weights = saved(tmp_path / "one")
    config = json.loads((tmp_path / "one" / "config.json").read_text())
    main(["average", str(tmp_path / "one"), "--symmetric", "--out", str(tmp_path / "out")])
    run = SavedRun(tmp_path / "out")
    assert run.policy().config.symmetric
    assert all(tensor.equal(weights[name]) for name, tensor in run.policy().state_dict().items())
    run.config["policy"]["config"]["symmetric"] = False
    (of,) = run.config.pop("average")
    assert run.config == config
    assert of["run"] == str(tmp_path / "one")


def test_scores_of_a_run_are_not_those_of_what_was_made_of_it(tmp_path):
    saved(tmp_path / "one")
    config = json.loads((tmp_path / "one" / "config.json").read_text())
    write_json(tmp_path / "one" / "config.json", {**config, "recipe": {"settings": {"out": str(tmp_path / "one")}}})
    (tmp_path / "evaluation.csv").write_text("policy,horizon,metric,value,low,high\none,mixed,tks,12.3,11,13\n")
    run = average_runs([tmp_path / "one"], tmp_path / "both", symmetric=True)
    assert SavedRun(tmp_path / "one").scores[0].value == 12.3
    assert run.scores is None
    assert made_by(run).endswith(", from one")
    assert "mean" not in made_by(run)


def test_a_mean_is_made_symmetric(tmp_path):
    save(tmp_path / "one", Expert(G1, EXPERT)), save(tmp_path / "last", Expert(G1, EXPERT))
    run = average_runs([tmp_path / "one", tmp_path / "last"], tmp_path / "mean", symmetric=True)
    assert run.policy().config == replace(EXPERT, symmetric=True)
    assert len(run.config["average"]) == 2


def test_a_policy_with_a_latent_is_made_symmetric_through_its_student(tmp_path):
    save(tmp_path / "one", ResidualLatentPolicy(LatentPolicy(G1, SMALL)))
    policy = average_runs([tmp_path / "one"], tmp_path / "out", symmetric=True).policy()
    assert policy.student.config == replace(SMALL, symmetric=True)


def test_a_student_is_given_a_reach_alone_and_within_a_policy(tmp_path):
    reach = WalkingReach(acceleration=1.0, speed=1.2, margin=0.1)
    save(tmp_path / "student", LatentPolicy(G1, SMALL))
    save(tmp_path / "whole", ResidualLatentPolicy(LatentPolicy(G1, SMALL)))
    given = average_runs([tmp_path / "student"], tmp_path / "given", reach=reach).policy()
    assert given.config == replace(SMALL, reach=reach)
    main(
        [
            "average",
            str(tmp_path / "whole"),
            "--reach",
            "speed=1.2,acceleration=1,margin=0.1",
            "--out",
            str(tmp_path / "out"),
        ]
    )
    out, whole = SavedRun(tmp_path / "out"), SavedRun(tmp_path / "whole")
    assert out.policy().student.config == given.config
    weights = whole.policy().state_dict()
    assert all(tensor.equal(weights[name]) for name, tensor in out.policy().state_dict().items())
    assert ("goal", "root_pos_b") in given.deployed().in_keys
    out.config["policy"]["student"]["config"]["reach"] = None
    del out.config["average"]
    assert out.config == whole.config


def test_an_expert_is_given_no_reach(tmp_path):
    save(tmp_path / "one", Expert(G1, EXPERT))
    with pytest.raises(CheckpointError, match="--reach: .*one' holds a 'expert' policy, which has no such setting"):
        average_runs([tmp_path / "one"], tmp_path / "out", reach=WalkingReach())
    assert not (tmp_path / "out").exists()


def test_an_average_knows_what_all_of_it_was_trained_on(tmp_path):
    for name, motions in (("a", ["bandai_train.npz"]), ("b", ["hard_free.npz"]), ("c", ["asap.npz", "hard_free.npz"])):
        saved(tmp_path / name)
        config = json.loads((tmp_path / name / "config.json").read_text())
        write_json(tmp_path / name / "config.json", {**config, "recipe": {"settings": {"motions": motions}}})
    average_runs([tmp_path / "a", tmp_path / "b"], tmp_path / "ab")
    run = average_runs([tmp_path / "ab", tmp_path / "c"], tmp_path / "abc")
    assert set(run.motions) == {"bandai_train.npz", "hard_free.npz", "asap.npz"}
    assert [set(part["motions"]) for part in run.config["average"]] == [
        {"bandai_train.npz", "hard_free.npz"},
        {"asap.npz", "hard_free.npz"},
    ]
    assert set(trained_on(run)) == {"bandai", "hard_free", "asap"}


def test_an_average_comes_from_all_runs_that_it_is_the_mean_of(tmp_path):
    for name, settings in (
        ("a", {"expert": "teacher"}),
        ("b", {"init": "start", "task": {"authored": 0.5}}),
        ("c", {}),
    ):
        saved(tmp_path / "runs" / name)
        config = json.loads((tmp_path / "runs" / name / "config.json").read_text())
        write_json(tmp_path / "runs" / name / "config.json", {**config, "recipe": {"settings": settings}})
    for name in ("teacher", "start"):
        write_json(tmp_path / "runs" / name / "config.json", {"recipe": {"settings": {"motions": [f"{name}.npz"]}}})
    run = average_runs([tmp_path / "runs" / name for name in "abc"], tmp_path / "mean")
    assert [parent.name for parent in parents(run)] == ["a", "b", "c"]
    assert made_by(run) == "plat, mean of 3 runs, from a and b and c"
    assert set(trained_on(run)) == {"teacher", "start", "authored keyframes"}


def test_an_average_of_an_older_plat_knows_its_last_run(tmp_path):
    config = {"recipe": {"settings": {"motions": ["a.npz"]}}, "average": [{"run": "x", "share": 0.5}, {"run": "y"}]}
    write_json(tmp_path / "config.json", config)
    assert SavedRun(tmp_path).motions == ["a.npz"]
    assert SavedRun("imagined-g1").motions


@pytest.mark.parametrize("motions", [5, "a.npz", [5], {"a": 1}])
def test_motions_of_an_odd_type_are_named(tmp_path, motions):
    for config, name in (
        ({"recipe": {"settings": {"motions": motions}}}, "recipe.settings"),
        ({"average": [{"motions": motions}]}, "average"),
    ):
        write_json(tmp_path / "config.json", config)
        with pytest.raises(CheckpointError, match=rf"config.json': {name}.motions is .*, expected a list of names"):
            _ = SavedRun(tmp_path).motions


def test_a_narrower_run_counts_as_the_wider_one_that_acts_like_it(tmp_path, library):
    saved(tmp_path / "narrow"), saved(tmp_path / "wide", hidden=24)
    narrow, wide = (SavedRun(tmp_path / name).policy_as(PlainPolicy, "a student") for name in ("narrow", "wide"))
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6))
    seen = task.observe(*task.start(5))
    nearly = average_runs([tmp_path / "narrow", tmp_path / "wide"], tmp_path / "nearly", (1, 1e-9)).policy()
    acted = [policy.deployed()(seen.copy())["action"] for policy in (narrow, nearly)]
    torch.testing.assert_close(*acted)
    half = average_runs([tmp_path / "narrow", tmp_path / "wide"], tmp_path / "half").policy().state_dict()
    first, new = "backbone.module.0.0.weight", slice(16, None)
    torch.testing.assert_close(half[first][new], wide.state_dict()[first][new])  # new units look at what they did
    second = "backbone.module.0.2.weight"
    torch.testing.assert_close(half[second][:, new], 0.5 * wide.state_dict()[second][:, new])


def test_a_folder_that_is_trained_into_is_left_alone(tmp_path):
    saved(tmp_path / "one"), (tmp_path / "busy").mkdir()
    held = (
        "import sys, pathlib, plat.runs.lock as it; lock = it.RunLock(pathlib.Path(sys.argv[1])); "
        "print(1, flush=True); input()"
    )
    command = [sys.executable, "-c", held, str(tmp_path / "busy")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as training:
        assert training.stdout.readline()
        with pytest.raises(CheckpointError, match="is writing into it"):
            average_runs([tmp_path / "one"] * 2, tmp_path / "busy")
        training.communicate(b"\n")
    assert not (tmp_path / "busy" / "config.json").exists()


@pytest.mark.parametrize("killed", [False, True])
def test_a_disk_that_takes_no_weights_leaves_nothing_that_blocks_the_next(tmp_path, monkeypatch, killed):
    saved(tmp_path / "one"), saved(tmp_path / "other")
    config = json.loads((tmp_path / "one" / "config.json").read_text())
    write_json(tmp_path / "one" / "config.json", {"format": "plat-run", **config})
    (tmp_path / "one" / "dynamics.safetensors").write_bytes(b"a model")
    out, as_left = tmp_path / "mean", tmp_path / "as_left"

    def full(path, policy):
        shutil.copytree(out, as_left)
        raise CheckpointError("No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(sys.modules["plat.runs.average"], "save_weights", full)
        with pytest.raises(CheckpointError, match="No space left"):
            average_runs([tmp_path / "other", tmp_path / "one"], out)
    assert {path.name for path in out.iterdir()} == {".lock"}
    assert {path.name for path in as_left.iterdir()} == {".lock", "config.json", "dynamics.safetensors"}
    run = average_runs([tmp_path / "one", tmp_path / "other"], as_left if killed else out)
    assert run.policy() is not None
    assert not (run.folder / "dynamics.safetensors").exists(), "the model of a start that was killed"
    with pytest.raises(CheckpointError, match="already holds a run"):
        average_runs([tmp_path / "one", tmp_path / "other"], run.folder)


def test_a_full_disk_names_the_file_that_it_does_not_take(tmp_path, monkeypatch):
    saved(tmp_path / "one")
    (tmp_path / "one" / "dynamics.safetensors").write_bytes(b"a model")

    def full(self, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pathlib.Path, "write_bytes", full)
    with pytest.raises(OutputError, match=r"mean.dynamics\.safetensors': cannot be written: No space left"):
        average_runs([tmp_path / "one"] * 2, tmp_path / "mean")
    assert not (tmp_path / "mean" / "config.json").exists()


def test_scores_of_the_last_run_are_not_the_averages(tmp_path):
    saved(tmp_path / "one")
    config = tmp_path / "one" / "config.json"
    config.write_text(json.dumps(json.loads(config.read_text()) | {"recipe": {"settings": {"out": "one"}}}))
    (tmp_path / "evaluation.csv").write_text("policy,horizon,seeds,metric,value,low,high\none,mixed,1,tks,99,98,100\n")
    assert SavedRun(tmp_path / "one").scores
    assert average_runs([tmp_path / "one"] * 2, tmp_path / "mean").scores is None


def test_whole_numbers_are_the_last_ones():
    one, other = nn.BatchNorm1d(2), nn.BatchNorm1d(2)
    other.num_batches_tracked += 5
    assert int(average_weights([one, other], [0.5, 0.5])["num_batches_tracked"]) == 5


def test_a_saved_average_is_like_any_other_run(tmp_path):
    saved(tmp_path / "one"), saved(tmp_path / "other")
    assert SavedRun(average_runs([tmp_path / "one", tmp_path / "other"], tmp_path / "mean").folder).steps == 16
