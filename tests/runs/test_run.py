import os
import subprocess
import sys
from dataclasses import dataclass

import pytest
import torch

from plat.errors import CheckpointError
from plat.modules import Expert, ExpertConfig
from plat.robots import G1
from plat.runs import Budget, Run, load_policy, read_json, write_json


@dataclass
class Settings:
    speed: float = 1.0


def start(
    folder, *, resume: bool = False, hidden: tuple[int, ...] = (8,), speed: float = 1.0
) -> tuple[Run, Expert, torch.optim.Adam, Budget]:
    policy = Expert(G1, ExpertConfig(hidden=hidden))
    optimizer = torch.optim.Adam(policy.parameters(), lr=1e-3)
    budget = Budget(steps=1000)
    run = Run(
        folder,
        recipe=Settings(speed),
        policy=policy,
        budget=budget,
        state={"optimizer": optimizer},
        resume=resume,
        save_every=1e9,
    )
    return run, policy, optimizer, budget


def train(policy: Expert, optimizer: torch.optim.Adam) -> None:
    loss = sum((parameter - torch.randn(())).square().sum() for parameter in policy.parameters())
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


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
    assert config["recipe"]["settings"] == {"speed": 1.0}
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
    assert read_json(tmp_path / "a" / "config.json")["recipe"]["settings"] == {"settings": {"speed": 1.0, "boost": 2.0}}


def test_config_says_what_earlier_parts_of_a_run_had(tmp_path):
    run, _, _, budget = start(tmp_path / "a")
    budget.add(10)
    run.save()
    start(tmp_path / "a", resume=True, speed=2.0)
    config = read_json(tmp_path / "a" / "config.json")
    assert config["recipe"]["settings"] == {"speed": 2.0}
    assert [part["until_step"] for part in config["earlier"]] == [10]
    assert config["earlier"][0]["recipe"]["settings"] == {"speed": 1.0}


def test_a_run_is_not_overwritten_by_accident(tmp_path):
    start(tmp_path / "a")
    with pytest.raises(CheckpointError, match="already holds a run: go on with --resume"):
        start(tmp_path / "a")


def test_resuming_with_another_policy_is_refused(tmp_path):
    start(tmp_path / "a")[0].save()
    with pytest.raises(CheckpointError, match="the run was of another policy"):
        start(tmp_path / "a", resume=True, hidden=(16,))


def test_resuming_before_the_first_checkpoint_starts_over(tmp_path):
    start(tmp_path / "a")
    assert start(tmp_path / "a", resume=True)[3].steps == 0


def test_resuming_what_is_not_there_starts(tmp_path):
    assert start(tmp_path / "a", resume=True)[3].steps == 0


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


def test_an_unreadable_checkpoint_is_named(tmp_path):
    run, _, _, budget = start(tmp_path / "a")
    budget.add(10)
    run.save()
    (payload,) = (tmp_path / "a" / "checkpoints").glob("*/components/*optimizer*/state.pt")
    payload.write_bytes(payload.read_bytes()[:50])
    with pytest.raises(CheckpointError, match="checkpoint-000000000010'?: this checkpoint cannot be resumed from"):
        start(tmp_path / "a", resume=True)


def test_checkpoints_run_no_code(tmp_path):
    run, _, _, budget = start(tmp_path / "a")
    budget.add(10)
    run.save()
    (payload,) = (tmp_path / "a" / "checkpoints").glob("*/components/*optimizer*/state.pt")
    torch.save(Evil(), payload)
    with pytest.raises(CheckpointError, match="cannot be resumed from"):
        start(tmp_path / "a", resume=True)
    assert not os.path.exists(Evil.proof)


class Evil:
    proof = "/tmp/plat-evil-proof"

    def __reduce__(self):
        return (os.system, (f"touch {self.proof}",))


@pytest.mark.skipif(os.name != "posix", reason="needs file size limits")
def test_a_full_disk_leaves_the_last_checkpoint(tmp_path):
    program = (
        "import resource, signal, sys\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "from pathlib import Path\n"
        "from plat.runs import report_errors\n"
        "from tests.runs.test_run import start\n"
        f"run, policy, optimizer, budget = start(Path({str(tmp_path / 'a')!r}))\n"
        "budget.add(10)\n"
        "run.save()\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))\n"
        "budget.add(10)\n"
        "with report_errors():\n"
        "    run.save()\n"
    )
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert out.returncode == 1
    assert "a checkpoint could not be written" in out.stderr
    assert "Traceback" not in out.stderr
    _, _, _, budget = start(tmp_path / "a", resume=True)
    assert budget.steps == 10
    load_policy(tmp_path / "a")


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


def test_a_finished_run_says_how_far_it_went(tmp_path):
    run, _, _, budget = start(tmp_path / "a")
    budget.add(70)
    assert "finished" not in read_json(tmp_path / "a" / "config.json")
    run.finish()
    finished = read_json(tmp_path / "a" / "config.json")["finished"]
    assert finished["steps"] == 70
    assert finished["seconds"] > 0
    start(tmp_path / "a", resume=True)  # and one that goes on is not finished
    assert "finished" not in read_json(tmp_path / "a" / "config.json")
