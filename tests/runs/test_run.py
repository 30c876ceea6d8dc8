import errno
import hashlib
import os
import re
import shutil
import signal
import sys
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict.nn import TensorDictModule
from torch import nn

from plat.envs import make_keyframe_env
from plat.errors import CheckpointError, ConfigError
from plat.modules import (
    STUDENT_KEYS,
    Backbone,
    Expert,
    ExpertConfig,
    FinetunedPolicy,
    GaussianNoise,
    GoalSequenceEncoder,
    LatentNoisePolicy,
    LatentPolicy,
    LatentPolicyConfig,
    LatentPrior,
    NormalizerConfig,
    ObservationNormalizer,
    PlainPolicy,
    PlainPolicyConfig,
    RefinementConfig,
    Residual,
    ResidualActionPolicy,
    ResidualLatentPolicy,
    mlp,
    sample_latent,
)
from plat.robots import G1
from plat.runs import Budget, Run, check_out, load_policy, read_json, register_policy, write_json
from plat.runs.policies import _KINDS
from plat.spec.observation import observation_size, student_keys
from tests.modules.policies.test_student import SMALL


@dataclass
class Settings:
    speed: float = 1.0
    lr: float = 0.1


def start(
    folder,
    *,
    resume: bool = False,
    hidden: tuple[int, ...] = (8,),
    speed: float = 1.0,
    lr: float = 0.1,
    steps: int = 1000,
    save_every: float = 1e9,
    **other,
) -> tuple[Run, Expert, torch.optim.Adam, Budget]:
    policy = Expert(G1, ExpertConfig(hidden=hidden))
    optimizer = torch.optim.Adam(policy.parameters(), lr=1e-3)
    budget = Budget(steps=steps)
    run = Run(
        folder,
        recipe=Settings(speed, lr),
        policy=policy,
        budget=budget,
        state={"optimizer": optimizer},
        resume=resume,
        save_every=save_every,
        **other,
    )
    return run, policy, optimizer, budget


def train(policy: Expert, optimizer: torch.optim.Adam) -> None:
    loss = sum((parameter - torch.randn(())).square().sum() for parameter in policy.parameters())
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


class Best:
    """A state of one's own."""

    def __init__(self, score):
        self.score = score

    def state_dict(self):
        return {"score": self.score}

    def load_state_dict(self, state):
        self.score = state["score"]


def begin(folder, **other) -> Run:
    policy = Expert(G1, ExpertConfig(hidden=(8,)))
    return Run(folder, **{"recipe": Settings(), "policy": policy, "budget": Budget(steps=10), "state": {}} | other)


@pytest.mark.parametrize("score", [np.float64(1.5), np.ones(2), Path("best")])
def test_a_state_that_could_not_be_read_again_is_told_when_it_is_written(tmp_path, score):
    run = begin(str(tmp_path / "run"), state={"best": Best(score)})
    with pytest.raises(
        CheckpointError, match=r"state 'best': its state_dict\(\) holds .*(numpy|Path).*; expected tensors"
    ):
        run.save()
    assert (tmp_path / "run" / "model.safetensors").exists()


def test_what_a_run_keeps_has_a_state_and_replaces_nothing_of_its_own(tmp_path):
    for kept, message in (
        ({"state": {"rate": 1e-3}}, "state 'rate' is a float, expected an object with state_dict"),
        ({"state": {"policy": nn.Linear(1, 1)}}, "state has 'policy', which the run keeps itself"),
        ({"modules": {"model.safetensors": nn.Linear(1, 1)}}, "modules has 'model.safetensors', which the run keeps"),
    ):
        with pytest.raises(ConfigError, match=message):
            begin(tmp_path / "run", **kept)
        assert not (tmp_path / "run").exists()
    policy = Expert(G1, ExpertConfig(hidden=(8,)))
    begin(tmp_path / "run", policy=policy, state={"policy": policy, "best": Best(1.5)}).save()


def test_a_resumed_run_goes_on_as_if_nothing_had_happened(tmp_path):
    run, policy, optimizer, budget = start(tmp_path / "a")
    for _ in range(3):
        train(policy, optimizer)
        budget.add(10)
    run.save()
    train(policy, optimizer)
    torch.manual_seed(99)
    run, resumed, optimizer, budget = start(tmp_path / "a", resume=True)
    assert budget.steps == 30
    train(resumed, optimizer)
    for ours, theirs in zip(resumed.parameters(), policy.parameters(), strict=True):
        assert torch.equal(ours, theirs)


def test_weights_beside_the_checkpoint_are_the_policys(tmp_path):
    run, policy, optimizer, _ = start(tmp_path / "a")
    train(policy, optimizer)
    run.finish()
    loaded = load_policy(tmp_path / "a")
    for name, value in loaded.state_dict().items():
        assert torch.equal(value, policy.state_dict()[name])


def test_config_says_what_was_run(tmp_path):
    start(tmp_path / "a")
    config = read_json(tmp_path / "a" / "config.json")
    assert config["recipe"]["settings"] == {"speed": 1.0, "lr": 0.1}
    assert config["policy"]["config"]["hidden"] == [8]
    assert set(config["made_with"]) == {"plat", "torch", "commit"}


def test_config_has_the_settings_that_a_users_subclass_adds(tmp_path):
    @dataclass
    class Faster(Settings):
        boost: float = 2.0

    @dataclass
    class Recipe:
        settings: Settings

    policy = Expert(G1, ExpertConfig(hidden=(8,)))
    Run(tmp_path / "a", recipe=Recipe(Faster()), policy=policy, budget=Budget(steps=1), state={})
    assert read_json(tmp_path / "a" / "config.json")["recipe"]["settings"] == {
        "settings": {"speed": 1.0, "lr": 0.1, "boost": 2.0}
    }


def with_tanh(module: nn.Module) -> nn.Module:
    """Replace the activations of a module."""
    for name, part in module.named_children():
        module.add_module(name, nn.Tanh() if isinstance(part, nn.ELU) else with_tanh(part))
    return module


class Shift(nn.Module):
    def forward(self, hidden, latent):
        return latent + hidden[..., : latent.shape[-1]]


def student(**parts) -> LatentPolicy:
    return LatentPolicy(G1, SMALL, **parts)


def of_residual(residual: nn.Module) -> ResidualLatentPolicy:
    return ResidualLatentPolicy(student(), RefinementConfig(hidden=(8,)), residual=residual)


SIZE = observation_size(student_keys(), G1)
FEATURES = ("hidden", ("prior", "loc"), ("prior", "loc"))
COMPOSED = {
    "normalizer.clip": lambda: student(
        normalizer=ObservationNormalizer(STUDENT_KEYS, SIZE, NormalizerConfig(clip=0.5))
    ),
    "backbone.module.0.1": lambda: student(backbone=with_tanh(Backbone(SIZE, (32,), 16))),
    "mode": lambda: student(mode=("prior", "scale")),
    "sample": lambda: student(sample=lambda group: sample_latent(group)),
    "prior.module.network.0.out_features": lambda: student(prior=LatentPrior(16, 4, (8,))),
    "prior.module.network.2": lambda: student(prior=LatentPrior(16, 4, (16, 16))),
    "encoder.module.embed.1": lambda: student(encoder=with_tanh(GoalSequenceEncoder(80, 8))),
    "residual.module.alpha": lambda: of_residual(Residual(16, 4, 4, (8,), 0.7, FEATURES, "refined_latent")),
    "residual.module.network.1": lambda: of_residual(
        with_tanh(Residual(16, 4, 4, (8,), 0.5, FEATURES, "refined_latent"))
    ),
    "residual": lambda: of_residual(TensorDictModule(Shift(), list(FEATURES[:2]), ["refined_latent"])),
    "student.mode": lambda: ResidualLatentPolicy(student(mode=("prior", "scale"))),
    "network.1": lambda: Expert(G1, ExpertConfig(hidden=(8,)), network=with_tanh(mlp(SIZE - 1, (8,), 29))),
    "noise.module.scale_lb": lambda: Expert(G1, ExpertConfig(hidden=(8,)), noise=GaussianNoise(29, 0.2, 0.1)),
}


@pytest.mark.parametrize("part", COMPOSED)
def test_a_policy_with_parts_of_its_own_is_refused_before_it_is_trained(tmp_path, part):
    policy = COMPOSED[part]()
    with pytest.raises(CheckpointError, match=rf"parts of its own \({part}\) would load as another .*register_policy"):
        Run(tmp_path / "a", recipe=Settings(), policy=policy, budget=Budget(steps=1), state={})
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    "policy",
    [
        lambda: student(normalizer=ObservationNormalizer(STUDENT_KEYS, SIZE), prior=LatentPrior(16, 4, (16,))),
        lambda: PlainPolicy(G1, PlainPolicyConfig(also=("clock",), symmetric=True)),
        lambda: LatentNoisePolicy(student(), RefinementConfig(alpha=0.3, lead=0.1)),
        lambda: ResidualActionPolicy(student()),
        lambda: FinetunedPolicy(student()),
        lambda: Expert(G1, ExpertConfig(hidden=(8,), ahead=(1, 2), action="reference_velocity", lead=0.1)),
    ],
)
def test_a_policy_that_will_load_as_it_is_begins_and_draws_nothing(tmp_path, policy):
    policy = policy()
    before = torch.random.get_rng_state()
    Run(tmp_path / "a", recipe=Settings(), policy=policy, budget=Budget(steps=1), state={})
    assert torch.equal(torch.random.get_rng_state(), before)


class OwnPrior(LatentPolicy):
    """Of a user, with a layer that has its size from its first input, and a number that training changes."""

    def __init__(self, robot, config=None, slope=0.1, gains=1):
        network = nn.Sequential(nn.LazyLinear(SMALL.latent_size), nn.LeakyReLU(slope))
        prior = TensorDictModule(network, ["hidden"], [("prior", "loc")])
        super().__init__(robot, config, prior=prior)
        self.updates = 0
        self.gain = nn.Parameter(torch.ones(gains))


def test_a_registered_policy_begins_where_build_makes_its_parts(tmp_path, monkeypatch, library):
    monkeypatch.setattr("plat.runs.policies._KINDS", dict(_KINDS))
    register_policy("own_prior", OwnPrior, LatentPolicyConfig)
    state = make_keyframe_env(library, 2).reset()
    lazy, whole, steeper = OwnPrior(G1, SMALL), OwnPrior(G1, SMALL), OwnPrior(G1, SMALL, slope=0.2)
    for policy in (whole, steeper):
        policy.deployed()(state.clone())
        policy.updates = 3
    for policy in (lazy, whole, FinetunedPolicy(whole)):
        Run(tmp_path / str(id(policy)), recipe=Settings(), policy=policy, budget=Budget(steps=1), state={})
    with pytest.raises(CheckpointError, match=r"parts of its own \(prior.module.1.negative_slope\)"):
        Run(tmp_path / "a", recipe=Settings(), policy=steeper, budget=Budget(steps=1), state={})
    with pytest.raises(CheckpointError, match=r"parts of its own \(size mismatch for gain: .*\) would load"):
        Run(tmp_path / "a", recipe=Settings(), policy=OwnPrior(G1, SMALL, gains=2), budget=Budget(steps=1), state={})


def test_a_robot_that_has_anothers_name_is_refused(tmp_path):
    policy = Expert(replace(G1, root_height=0.7), ExpertConfig(hidden=(8,)))
    with pytest.raises(CheckpointError, match="robot 'g1' of the policy is not the one of that name"):
        Run(tmp_path / "a", recipe=Settings(), policy=policy, budget=Budget(steps=1), state={})


def test_what_may_change_changes_and_is_written_down(tmp_path, capsys):
    run, _, _, budget = start(tmp_path / "a")
    budget.add(10)
    run.save()
    start(tmp_path / "a", resume=True, lr=0.2)
    assert "goes on with lr 0.2 in place of 0.1\n" in capsys.readouterr().out
    config = read_json(tmp_path / "a" / "config.json")
    assert config["recipe"]["settings"] == {"speed": 1.0, "lr": 0.2}
    assert [part["until_step"] for part in config["earlier"]] == [10]
    assert config["earlier"][0]["changed"] == {"lr": [0.1, 0.2]}
    assert config["earlier"][0]["recipe"]["settings"] == {"speed": 1.0, "lr": 0.1}


def test_what_may_not_change_is_refused_by_name(tmp_path):
    inputs = {"motions": [["walk", 9, 0.5, 0.1]], "expert": "ab"}
    run, *_ = start(tmp_path / "a", inputs=inputs)
    run.save()
    before = (tmp_path / "a" / "config.json").read_bytes()
    inputs = {"motions": [["walk", 9, 0.5, 0.2]], "expert": "ac"}
    with pytest.raises(CheckpointError) as error:
        start(tmp_path / "a", resume=True, speed=2.0, inputs=inputs)
    message = str(error.value)
    assert "speed is 2.0, was 1.0; expert: other content; motions: clip 0 'walk' has other content." in message
    assert "Budget and learning rates may change" in message
    assert (tmp_path / "a" / "config.json").read_bytes() == before


def test_a_run_is_not_overwritten_by_accident(tmp_path):
    start(tmp_path / "a")[0].save()
    with pytest.raises(CheckpointError, match="already holds a run: go on with --resume"):
        start(tmp_path / "a")


def test_resuming_with_another_policy_is_refused(tmp_path):
    start(tmp_path / "a")[0].save()
    with pytest.raises(CheckpointError, match="the run was of another policy"):
        start(tmp_path / "a", resume=True, hidden=(16,))


def test_resuming_before_the_first_checkpoint_starts_over(tmp_path, capsys):
    start(tmp_path / "a")[0].log({"loss": 1.0})
    assert start(tmp_path / "a", resume=True, speed=2.0)[3].steps == 0
    assert "the run has no checkpoint yet, it starts over" in capsys.readouterr().out
    assert read_json(tmp_path / "a" / "config.json")["recipe"]["settings"]["speed"] == 2.0
    assert (tmp_path / "a" / "metrics.csv").read_text() == "step\n"


@pytest.mark.parametrize("there", [False, True])
def test_resuming_what_is_not_there_does_nothing(tmp_path, there):
    folder = tmp_path / "a"
    if there:
        folder.mkdir()
    with pytest.raises(CheckpointError, match="holds no run to go on with: leave out --resume"):
        start(folder, resume=True)
    assert folder.exists() == there
    assert not list(folder.glob("*"))


def test_a_run_without_checkpoints_is_not_started_over(tmp_path):
    start(tmp_path / "a")[0].save()
    shutil.rmtree(tmp_path / "a" / "checkpoints")
    weights = (tmp_path / "a" / "model.safetensors").read_bytes()
    with pytest.raises(CheckpointError, match="weights but no checkpoint to go on from"):
        start(tmp_path / "a", resume=True)
    assert (tmp_path / "a" / "model.safetensors").read_bytes() == weights


def test_a_start_that_fails_blocks_no_other(tmp_path, monkeypatch):
    folder = tmp_path / "new" / "a"
    monkeypatch.setattr("plat.runs.run.start_logging", lambda *_: (_ for _ in ()).throw(RuntimeError("no network")))
    monkeypatch.setattr("plat.runs.run.check_logger", lambda _: None)
    with pytest.raises(RuntimeError, match="no network"):
        start(folder, loggers=("wandb",))
    assert not folder.exists()
    start(folder)  # and one that fails in its first iteration, which leaves settings and metrics
    run, _, _, budget = start(folder, speed=3.0)
    budget.add(10)
    run.log({"loss": 1.0})
    assert read_json(folder / "config.json")["recipe"]["settings"]["speed"] == 3.0
    assert (folder / "metrics.csv").read_text().count("\n") == 2


@pytest.mark.parametrize("left", ["checkpoints", "model.safetensors"])
@pytest.mark.parametrize("resume", [False, True])
def test_a_run_whose_settings_are_lost_is_mixed_with_no_other(tmp_path, left, resume):
    start(tmp_path / "a")[0].save()
    (tmp_path / "b").mkdir()
    (tmp_path / "a" / left).rename(tmp_path / "b" / left)
    with pytest.raises(
        CheckpointError, match="b' holds weights or checkpoints of a run whose config.json is lost: put"
    ):
        start(tmp_path / "b", resume=resume)
    assert [path.name for path in (tmp_path / "b").iterdir()] == [left]


def test_a_foreign_config_is_not_overwritten(tmp_path):
    (tmp_path / "config.json").write_text('{"name": "another program"}')
    with pytest.raises(CheckpointError, match="already holds a run"):
        start(tmp_path)
    with pytest.raises(CheckpointError, match="already holds a run"):
        check_out(tmp_path, resume=False)


@pytest.mark.parametrize("checkpoint", [False, True])
def test_what_is_no_run_is_not_resumed(tmp_path, checkpoint):
    (tmp_path / "config.json").write_text('{"name": "another program"}')
    if checkpoint:
        (tmp_path / "checkpoints" / "checkpoint-000000000010").mkdir(parents=True)
    with pytest.raises(CheckpointError, match="is of no run of plat: choose another --out"):
        start(tmp_path, resume=True)
    assert (tmp_path / "config.json").read_text() == '{"name": "another program"}'


def test_a_run_of_a_newer_plat_is_neither_resumed_nor_overwritten(tmp_path):
    start(tmp_path)[0].save()
    config = {**read_json(tmp_path / "config.json"), "version": 2}
    write_json(tmp_path / "config.json", config)
    with pytest.raises(CheckpointError, match="config.json': version is 2, this plat reads up to 1: update plat"):
        start(tmp_path, resume=True)
    for path in tmp_path.glob("*.safetensors"):  # that plat may call them otherwise
        path.unlink()
    shutil.rmtree(tmp_path / "checkpoints")
    with pytest.raises(CheckpointError, match="already holds a run"):
        start(tmp_path)
    assert read_json(tmp_path / "config.json") == config


def test_a_checkpoint_that_was_about_to_be_replaced_is_put_back(tmp_path):
    run, _, _, budget = start(tmp_path / "a")
    budget.add(10)
    run.save()
    (checkpoint,) = (tmp_path / "a" / "checkpoints").iterdir()
    checkpoint.rename(checkpoint.with_name(f".{checkpoint.name}.backup-dead"))
    (checkpoint.parent / f".{checkpoint.name}.stage-dead").mkdir()
    assert start(tmp_path / "a", resume=True)[3].steps == 10
    assert [path.name for path in checkpoint.parent.iterdir()] == [checkpoint.name]


def test_two_checkpoints_are_kept_and_leftovers_cleared(tmp_path):
    run, _, _, budget = start(tmp_path / "a")
    for _ in range(4):
        budget.add(10)
        run.save()
    folder = tmp_path / "a" / "checkpoints"
    assert len(list(folder.iterdir())) == 2
    (folder / ".checkpoint-000000000050.stage-dead").mkdir()
    start(tmp_path / "a", resume=True)
    assert len(list(folder.iterdir())) == 2


def damage(folder: Path, step: int) -> None:
    """Change one byte of a checkpoint."""
    (payload,) = folder.glob(f"checkpoints/*{step}/components/*optimizer*/state.pt")
    content = bytearray(payload.read_bytes())
    content[len(content) // 2] ^= 1
    payload.write_bytes(content)


def test_a_damaged_checkpoint_falls_back_to_the_one_before(tmp_path, capsys):
    run, _, _, budget = start(tmp_path / "a")
    for _ in range(2):
        budget.add(10)
        run.save()
    damage(tmp_path / "a", 20)
    run, _, _, budget = start(tmp_path / "a", resume=True)
    assert budget.steps == 10
    out = capsys.readouterr().out
    assert "checkpoint-000000000020' is damaged (optimizer: state.pt is not what was written)" in out
    for _ in range(2):  # the damaged one does not push out whole ones
        budget.add(5)
        run.save()
    names = sorted(path.name for path in (tmp_path / "a" / "checkpoints").iterdir())
    assert names == ["checkpoint-000000000015", "checkpoint-000000000020", "damaged-checkpoint-000000000020"]


@pytest.mark.parametrize("what", ["a name in the manifest", "a file without a hash, of an older plat"])
def test_damage_that_no_hash_tells_falls_back_as_well(tmp_path, capsys, what):
    run, _, _, budget = start(tmp_path / "a")
    for _ in range(2):
        budget.add(10)
        run.save()
    newest = tmp_path / "a" / "checkpoints" / "checkpoint-000000000020"
    manifest = newest / "manifest.json"
    if "manifest" in what:
        manifest.write_text(manifest.read_text().replace('"optimizer": {', '"optimizes": {'))
    else:
        content = read_json(manifest)
        for record in content["components"].values():
            record["files"].remove("state.pt.blake2b")
        write_json(manifest, content)
        for mark in newest.glob("components/*/state.pt.blake2b"):
            mark.unlink()
        (payload,) = newest.glob("components/*optimizer*/state.pt")
        payload.write_bytes(payload.read_bytes()[: payload.stat().st_size // 2])
    assert start(tmp_path / "a", resume=True)[3].steps == 10
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "is damaged" in line]
    assert "checkpoint-000000000020' is damaged (" in line
    assert "optimizer" in line
    assert (newest.parent / f"damaged-{newest.name}").is_dir()


def test_checkpoints_that_are_all_damaged_are_named(tmp_path):
    run, _, _, budget = start(tmp_path / "a")
    for _ in range(2):
        budget.add(10)
        run.save()
        damage(tmp_path / "a", budget.steps)
    before = sorted(path for path in (tmp_path / "a").rglob("*") if "checkpoint" in str(path))
    with pytest.raises(
        CheckpointError, match=r"no checkpoint can be resumed from \(checkpoint-000000000020: optimizer"
    ):
        start(tmp_path / "a", resume=True)
    assert sorted(path for path in (tmp_path / "a").rglob("*") if "checkpoint" in str(path)) == before


@pytest.mark.parametrize("name", ["manifest.json", "components/*optimizer*/state.pt"])
def test_a_checkpoint_that_lacks_a_file_or_half_of_one_is_damaged(tmp_path, name):
    run, _, _, budget = start(tmp_path / "a")
    for _ in range(2):
        budget.add(10)
        run.save()
    (path,) = (tmp_path / "a" / "checkpoints" / "checkpoint-000000000020").glob(name)
    path.write_bytes(path.read_bytes()[:50])
    assert start(tmp_path / "a", resume=True)[3].steps == 10
    (path,) = (tmp_path / "a" / "checkpoints" / "checkpoint-000000000010").glob(name)
    path.unlink()
    with pytest.raises(CheckpointError, match="no checkpoint can be resumed from"):
        start(tmp_path / "a", resume=True)


def test_checkpoints_run_no_code(tmp_path):
    run, _, _, budget = start(tmp_path / "a")
    budget.add(10)
    run.save()
    (payload,) = (tmp_path / "a" / "checkpoints").glob("*/components/*optimizer*/state.pt")
    torch.save(Evil(), payload)
    # whoever writes such a file writes its hash as well
    payload.with_name("state.pt.blake2b").write_text(hashlib.blake2b(payload.read_bytes(), digest_size=32).hexdigest())
    with pytest.raises(CheckpointError, match="cannot be resumed from"):
        start(tmp_path / "a", resume=True)
    assert not os.path.exists(Evil.proof)


class Evil:
    proof = "/tmp/plat-evil-proof"

    def __reduce__(self):
        return (os.system, (f"touch {self.proof}",))


def test_a_full_disk_leaves_the_last_checkpoint(tmp_path):
    run, _, _, budget = start(tmp_path / "a")
    for _ in range(2):
        budget.add(10)
        run.save()
    budget.add(10)
    with full_disk(), pytest.raises(CheckpointError, match="a checkpoint could not be written"):
        run.save()
    assert start(tmp_path / "a", resume=True)[3].steps == 20
    load_policy(tmp_path / "a")


def test_weights_are_written_where_a_checkpoint_does_not_fit(tmp_path, monkeypatch):
    run, policy, _, budget = start(tmp_path / "a")
    run.save()
    with torch.no_grad():
        next(policy.parameters()).add_(1)

    def full(*_, **__):
        raise RuntimeError("unexpected pos 1344 vs 1238")

    monkeypatch.setattr(run._checkpoints._rotation, "save", full)
    monkeypatch.setattr("plat.runs.checkpoints.is_full", lambda _: True)
    budget.add(10)
    with pytest.raises(CheckpointError, match=r"could not be written \(no space left on device\); the one before it"):
        run.save()
    written = load_policy(tmp_path / "a").state_dict()
    assert all(torch.equal(tensor, written[name]) for name, tensor in policy.state_dict().items())


def test_a_run_of_an_older_plat_is_resumed(tmp_path):
    run, *_ = start(tmp_path / "a")
    run.save()
    config = read_json(tmp_path / "a" / "config.json")
    del config["policy"]["config"]["ahead"]  # which it did not know
    write_json(tmp_path / "a" / "config.json", config)
    start(tmp_path / "a", resume=True)
    config["policy"]["config"]["hidden"] = [9]
    write_json(tmp_path / "a" / "config.json", config)
    with pytest.raises(CheckpointError, match="another policy"):
        start(tmp_path / "a", resume=True)


def test_a_setting_that_an_older_plat_lacked_counts_as_its_default(tmp_path, capsys):
    run, *_ = start(tmp_path / "a")
    run.save()
    config = read_json(tmp_path / "a" / "config.json")
    config["recipe"]["settings"] = {}
    write_json(tmp_path / "a" / "config.json", config)
    with pytest.raises(CheckpointError, match="speed is 2.0, was 1.0"):
        start(tmp_path / "a", resume=True, speed=2.0)
    start(tmp_path / "a", resume=True, lr=0.2)
    assert "goes on with lr 0.2 in place of 0.1\n" in capsys.readouterr().out


def test_a_checkpoint_that_does_not_fit_is_refused_in_one_line_that_names_the_version(tmp_path):
    run, _, _, budget = start(tmp_path / "a")
    budget.add(10)
    run.save()

    class Other(dict):
        def load_state_dict(self, state):
            raise self["error"]

        def state_dict(self):
            return {}

    def resume(error: Exception, made_with: dict) -> str:
        config = read_json(tmp_path / "a" / "config.json")
        write_json(tmp_path / "a" / "config.json", {**config, "made_with": made_with})
        with pytest.raises(CheckpointError, match="cannot be resumed from") as caught:
            Run(
                tmp_path / "a",
                recipe=Settings(),
                policy=Expert(G1, ExpertConfig(hidden=(8,))),
                budget=Budget(steps=1000),
                state={"optimizer": Other(error=error)},
                resume=True,
            )
        return str(caught.value)

    now = read_json(tmp_path / "a" / "config.json")["made_with"]
    lines = resume(RuntimeError('Error(s) in loading:\n\tMissing key(s): "a"'), now)
    assert lines.endswith("""('optimizer': Error(s) in loading: Missing key(s): "a")""")
    told = resume(KeyError("drift"), {"plat": "0.0.1", "commit": "abcdef0123456"})
    assert "('optimizer' lacks 'drift'); plat 0.0.1 (abcdef012) wrote it, and this is plat " in told
    assert "\n" not in lines + told
    assert len(resume(RuntimeError("x" * 9999), now)) < 700
    assert "plat of an unknown version wrote it" in resume(KeyError("drift"), None)


def test_a_finished_run_stays_finished(tmp_path, capsys):
    run, _, _, budget = start(tmp_path / "a", steps=70)
    budget.add(70)
    assert "finished" not in read_json(tmp_path / "a" / "config.json")
    run.finish()
    finished = read_json(tmp_path / "a" / "config.json")["finished"]
    assert finished["steps"] == 70
    assert finished["seconds"] > 0
    before = {path: path.read_bytes() for path in (tmp_path / "a").rglob("*") if path.is_file()}
    run, policy, _, budget = start(tmp_path / "a", steps=70, resume=True)
    assert run.finished
    assert budget.done
    assert torch.equal(policy.state_dict()["normalizer.mean"], load_policy(tmp_path / "a").normalizer.mean)
    run.finish()
    assert {path: path.read_bytes() for path in (tmp_path / "a").rglob("*") if path.is_file()} == before
    assert "the run is finished, with 70 steps; it goes on with more --steps" in capsys.readouterr().out


def test_a_finished_run_whose_weights_are_damaged_is_named(tmp_path):
    run, _, _, budget = start(tmp_path / "a", steps=70)
    budget.add(70)
    run.finish()
    weights = tmp_path / "a" / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:500])
    with pytest.raises(CheckpointError, match="model.safetensors': not a readable safetensors file"):
        start(tmp_path / "a", steps=70, resume=True)


def test_a_finished_run_goes_on_with_more_steps(tmp_path):
    run, _, _, budget = start(tmp_path / "a", steps=70)
    budget.add(70)
    run.finish()
    run, *_ = start(tmp_path / "a", resume=True, steps=100)
    assert not run.finished
    assert "finished" not in read_json(tmp_path / "a" / "config.json")  # one that goes on is not


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("finished", [1], "finished is [1], expected an object"),
        ("finished", {"seconds": 1}, "finished.steps is missing"),
        ("finished", {"steps": "x", "seconds": 1}, "finished.steps is 'x', expected a valid integer"),
        ("finished", {"steps": -1, "seconds": 1}, "finished.steps is -1, expected greater than or equal to 0"),
        ("recipe", "refine", "recipe is 'refine', expected an object"),
        ("recipe", {"name": 5}, "recipe.name is 5, expected a valid string"),
        ("recipe", {"settings": [1]}, "recipe.settings is [1], expected an object"),
        ("earlier", 5, "earlier is 5, expected a valid list"),
        ("earlier", [5], "earlier.0 is 5, expected an object"),
    ],
)
def test_odd_types_in_a_config_are_named(tmp_path, name, value, message):
    start(tmp_path / "a")[0].save()
    path = tmp_path / "a" / "config.json"
    write_json(path, {**read_json(path), name: value})
    with pytest.raises(CheckpointError, match=re.escape(f"{str(path)!r}: {message}")):
        start(tmp_path / "a", resume=True)


@pytest.mark.parametrize("motions", [5, None, [1], [["walk", 9]], [["walk", "x", 0.5, 0.1]], [["walk", 9, "x", 0.2]]])
def test_odd_types_in_inputs_are_said_and_not_compared(tmp_path, capsys, motions):
    inputs = {"motions": [["walk", 9, 0.5, 0.1]]}
    run, _, _, budget = start(tmp_path / "a", inputs=inputs)
    budget.add(10)
    run.save()
    write_json(tmp_path / "a" / "inputs.json", {"motions": motions})
    assert start(tmp_path / "a", resume=True, inputs=inputs)[3].steps == 10
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "without a comparison" in line]
    assert "inputs.json': motions" in line


def test_ctrl_c_saves_and_says_how_to_go_on(tmp_path, capsys):
    run, _, _, budget = start(tmp_path / "a")

    def train():
        with run:
            budget.add(10)
            run.log({"loss": 1.0})
            signal.raise_signal(signal.SIGINT)
            budget.add(10)  # the iteration goes on to its end
            run.log({"loss": 1.0})
            budget.add(10)

    with pytest.raises(SystemExit) as ended:
        train()
    assert ended.value.code == 130
    out = capsys.readouterr().out
    assert "stopped with a checkpoint at 20 steps\n" in out
    assert f"go on with the same command, and --resume where it has that (--out {tmp_path / 'a'})\n" in out
    assert start(tmp_path / "a", resume=True)[3].steps == 20


def test_ctrl_c_while_a_run_ends_ends_the_program_that_would_go_on(tmp_path, capsys):
    run, _, _, budget = start(tmp_path / "a", steps=10)

    def train():
        with run:
            budget.add(10)
            signal.raise_signal(signal.SIGINT)
            run.log({"loss": 1.0})
            run.finish()

    with pytest.raises(SystemExit) as ended:
        train()
    assert ended.value.code == 130
    assert "finished" in read_json(tmp_path / "a" / "config.json")
    assert capsys.readouterr().out.endswith(f"{str(tmp_path / 'a')!r}: the run is finished, with 10 steps\n")


def test_a_reader_that_leaves_costs_no_training(tmp_path, monkeypatch):
    """Ctrl-C ends ``tee`` first: then nothing that is printed may end the program before it has saved."""

    class Left:
        def write(self, text: str) -> int:
            raise BrokenPipeError(errno.EPIPE, "Broken pipe")

        flush = isatty = lambda self: False

    run, _, _, budget = start(tmp_path / "a")

    def train():
        with run:
            monkeypatch.setattr(sys.stdout, "stream", Left())
            for _ in range(5):
                budget.add(10)
                run.log({"loss": 1.0})

    with pytest.raises(SystemExit) as ended:
        train()
    assert ended.value.code == 141
    assert start(tmp_path / "a", resume=True)[3].steps == 10


def test_names_that_are_no_text(tmp_path):
    """As Latin-1 names in archives of other systems are: a run ended with an error when it was done."""
    name = os.fsdecode(b"K\xf6ln")
    with pytest.raises(CheckpointError, match="its name is no UTF-8"):
        start(tmp_path / name)
    run, *_ = start(tmp_path / "a", inputs={"clips": [name]})
    run.finish()
    start(tmp_path / "a", resume=True, inputs={"clips": [name]})


@pytest.mark.parametrize("moved", [True, False])
def test_a_folder_that_is_moved_or_removed_is_begun_anew(tmp_path, capsys, moved):
    folder, other = tmp_path / "a", tmp_path / "b"
    run, policy, optimizer, budget = start(folder)
    with run:
        for number in range(4):
            train(policy, optimizer)
            budget.add(10)
            run.log({"loss": float(number)})
            if number == 1:
                run.save()
                folder.rename(other)
                if not moved:
                    shutil.rmtree(other)
    assert capsys.readouterr().out.count("was moved or removed") == 1
    assert (folder / "metrics.csv").read_text().count("\n") == 5, "a head and all four rows"
    assert start(folder, resume=True)[3].steps == 30
    if moved:
        assert start(other, resume=True)[3].steps == 20


def hashes(folder: Path) -> dict[str, str]:
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != ".lock"]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.parametrize("finished", [True, False])
def test_another_run_that_takes_the_folders_place_is_left_as_it_is(tmp_path, finished):
    folder, other = tmp_path / "a", tmp_path / "b"
    run, _, _, budget = start(other, speed=2.0)
    with run:
        for _ in range(3):
            budget.add(10)
            run.log({"loss": 0.5})
            run.save()
        if finished:
            run.finish()
    before = hashes(other)
    run, _, _, budget = start(folder)
    with run:
        budget.add(10)
        run.log({"loss": 1.0})
        run.save()
        folder.rename(tmp_path / "old")
        other.rename(folder)
        budget.add(10)
        with pytest.raises(CheckpointError, match="replaced while it was trained into: '.*a' already holds a run"):
            run.log({"loss": 2.0})
    assert hashes(folder) == before
    assert start(folder, speed=2.0, resume=True)[3].steps == 30
    assert start(tmp_path / "old", resume=True)[3].steps == 10


def test_a_copy_of_the_folder_in_its_place_is_gone_on_with(tmp_path):
    """As where it was moved to another disk, and linked."""
    folder, other = tmp_path / "a", tmp_path / "b"
    start(folder)[0].save()
    run, _, _, budget = start(folder, resume=True, lr=0.2)
    with run:
        for number in range(3):
            budget.add(10)
            run.log({"loss": float(number)})
            if number == 1:
                run.save()
                folder.rename(tmp_path / "old")
                shutil.copytree(tmp_path / "old", other)
                folder.symlink_to(other)
    assert start(other, resume=True, lr=0.2)[3].steps == 30


@contextmanager
def full_disk():
    """Files that grow beyond a few bytes fail, as a context."""
    resource = pytest.importorskip("resource", reason="needs file size limits")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (12, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def test_training_goes_on_where_the_disk_is_full(tmp_path, monkeypatch):
    said = []
    monkeypatch.setattr("builtins.print", lambda *words, **_: said.append(" ".join(words)))
    run, _, _, budget = start(tmp_path / "a", save_every=0)
    budget.add(10)
    run.log({"loss": 1})
    with full_disk():
        for _ in range(3):
            budget.add(10)
            run.log({"loss": 1})
    out = "\n".join(said)
    assert out.count("training goes on without a checkpoint") == 3
    assert out.count("could not be written (the disk did not take all of it: it may be full); the one before") == 3
    assert out.count("rows are kept, training goes on") == 1
    assert start(tmp_path / "a", resume=True)[3].steps == 10
    budget.add(10)
    run.log({"loss": 1})
    rows = (tmp_path / "a" / "metrics.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["step", "10", "20", "30", "40", "50"]
    assert start(tmp_path / "a", resume=True)[3].steps == 50


def test_training_goes_on_where_the_folder_is_moved_and_the_disk_is_full(tmp_path, capsys):
    folder = tmp_path / "a"
    run, policy, optimizer, budget = start(folder)
    with run:
        for number in range(4):
            train(policy, optimizer)
            budget.add(10)
            if number == 1:
                run.save()
                folder.rename(tmp_path / "b")
                with full_disk():
                    run.log({"loss": 0.0})
                    run.log({"loss": 0.5})
            else:
                run.log({"loss": float(number)})
    assert capsys.readouterr().out.count("training goes on without its folder") == 1
    assert (folder / "metrics.csv").read_text().count("\n") == 6
    assert start(folder, resume=True)[3].steps == 30


def test_a_folder_that_cannot_be_made_for_a_while(tmp_path, capsys):
    """As where the folder was moved and its place is a link to a disk that is not there at the moment."""
    folder = tmp_path / "mount" / "a"
    run, policy, optimizer, budget = start(folder)
    with run:
        folder.parent.rename(tmp_path / "away")
        folder.parent.symlink_to(tmp_path / "nowhere")
        for number in range(3):
            train(policy, optimizer)
            budget.add(10)
            run.log({"loss": float(number)})
            if number == 1:
                folder.parent.unlink()
    assert capsys.readouterr().out.count("training goes on without its folder") == 1
    assert start(folder, resume=True)[3].steps == 30


def test_a_run_is_resumed_where_the_disk_is_full(tmp_path, monkeypatch):
    said = []
    monkeypatch.setattr("builtins.print", lambda *words, **_: said.append(" ".join(words)))
    start(tmp_path / "a")[0].save()
    with full_disk():
        run, *_ = start(tmp_path / "a", resume=True)
        run.log({"loss": 1})
    assert any(line.startswith("not written down: ") for line in said)


@pytest.fixture
def logger(monkeypatch):
    """A logger that is there and logs nothing."""

    class Logger:
        def log(self, *_, **__):
            pass

    monkeypatch.setattr("plat.runs.run.start_logging", lambda *_: Logger())
    monkeypatch.setattr("plat.runs.run.check_logger", lambda _: None)


@pytest.mark.usefixtures("logger")
def test_videos_and_checkpoints_are_no_training(tmp_path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])

    def takes(seconds):
        now[0] += seconds

    run, *_, budget = start(tmp_path / "a", save_every=1, loggers=("wandb",), film=lambda _: takes(100))
    write = run._checkpoints._rotation.save
    monkeypatch.setattr(run._checkpoints._rotation, "save", lambda *args, **kw: (takes(1000), write(*args, **kw)))
    with run:
        for _ in range(2):
            takes(10)
            budget.add(10)
            run.log({})
    assert now[0] == 2220
    assert budget.seconds == 20
    assert start(tmp_path / "a", resume=True)[3].seconds == 20


@pytest.mark.usefixtures("logger")
def test_videos_take_no_random_numbers(tmp_path):
    run, *_ = start(tmp_path / "a", loggers=("wandb",), film=lambda step: (torch.rand(3), None)[1])
    torch.manual_seed(0)
    wanted = torch.rand(1)
    torch.manual_seed(0)
    run.log({})
    assert torch.equal(torch.rand(1), wanted)


@pytest.fixture
def tracked(monkeypatch) -> dict[str, dict[int, float]]:
    """The loss by step that loggers were given, by the id of the training."""
    runs: dict[str, dict[int, float]] = {}

    class Logger:
        def __init__(self, run_id):
            self.rows = runs.setdefault(run_id, {})

        def log(self, entries, step):
            assert step not in self.rows, "loggers take no row back"
            self.rows[step] = entries["loss"]

    monkeypatch.setattr("plat.runs.run.start_logging", lambda logger, name, folder, config, run_id: Logger(run_id))
    monkeypatch.setattr("plat.runs.run.check_logger", lambda _: None)
    return runs


def tracked_steps(folder: Path, count: int, factor: float, save_at: int = 0, **settings) -> None:
    """Some iterations of a run that is killed after them."""
    run, _, _, budget = start(folder, loggers=("trackio",), **settings)
    for _ in range(count):
        budget.add(10)
        run.log({"loss": factor * budget.steps})
        if budget.steps == save_at:
            run.save()
    run._lock.release()


def test_curves_of_a_resumed_run_hold_no_rows_that_were_undone(tmp_path, tracked):
    tracked_steps(tmp_path / "a", 4, 1.0, save_at=20)
    tracked_steps(tmp_path / "a", 2, 2.0, save_at=40, resume=True)
    assert list(tracked.values()) == [{10: 10, 20: 20, 30: 30, 40: 40}, {10: 10, 20: 20, 30: 60, 40: 80}]
    # nothing is undone: the same curve goes on
    tracked_steps(tmp_path / "a", 1, 1.0, resume=True)
    assert list(tracked.values())[1:] == [{10: 10, 20: 20, 30: 60, 40: 80, 50: 50}]


def test_a_run_that_starts_over_has_curves_of_its_own(tmp_path, tracked):
    tracked_steps(tmp_path / "a", 2, 1.0)
    tracked_steps(tmp_path / "a", 1, 5.0, resume=True)
    assert list(tracked.values()) == [{10: 10, 20: 20}, {10: 50}]


def test_loggers_go_on_with_a_run_whose_folder_was_moved(tmp_path, tracked):
    folder = tmp_path / "a"
    run, _, _, budget = start(folder, loggers=("trackio",))
    budget.add(10)
    folder.rename(tmp_path / "b")
    run.log({"loss": 1.0})
    run.save()
    run._lock.release()
    tracked_steps(folder, 1, 1.0, resume=True)
    assert list(tracked.values()) == [{10: 1.0, 20: 20.0}]


def test_all_loggers_of_a_run_have_its_id(tmp_path, tracked):
    start(tmp_path / "a", loggers=("trackio", "wandb"))
    assert list(tracked) == [(tmp_path / "a" / "logging_id").read_text()]
