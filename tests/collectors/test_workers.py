import os
import re
import signal
import tempfile
from collections.abc import Callable
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path

import pytest
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torch import nn

from plat.collectors import Rollouts, WorkerRollouts, collect, worker
from plat.collectors.hosts import Processes
from plat.collectors.worker import Job, _from_folder, in_folder
from plat.collectors.workers import _merged
from plat.envs import make_keyframe_env, make_tracking_env
from plat.errors import ConfigError, MotionError, OutputError, StateError, WorkerError
from plat.modules import Expert, PlainPolicy, PlainPolicyConfig
from plat.motions import MotionLibrary, generate_motions
from plat.robots import G1
from plat.spec.timing import Timing


@cache
def motions() -> MotionLibrary:
    return MotionLibrary.from_clips(generate_motions("train", seconds=8))


class Flailing(nn.Module):
    """Actions so wild that robots fall within a second, as wild as its one weight says."""

    def __init__(self):
        super().__init__()
        self.scale = nn.Parameter(torch.tensor(3.0))

    def forward(self, joint_pos: torch.Tensor) -> torch.Tensor:
        return self.scale * torch.randn(len(joint_pos), 29)


def flailing() -> TensorDictModule:
    return TensorDictModule(Flailing(), [("robot", "joint_pos")], ["action"])


def assert_same(found: TensorDictBase, wanted: TensorDictBase) -> None:
    assert set(found.keys(True, True)) == set(wanted.keys(True, True))
    for key, value in wanted.items(True, True):
        assert torch.equal(found[key], value), key


def kill(source: WorkerRollouts, number: int) -> None:
    os.kill(source._workers[number]._collector.procs[0].pid, signal.SIGKILL)


def check_one_worker_is_as_one_process(kill: Callable[[WorkerRollouts, int], None], **options: bool) -> WorkerRollouts:
    """Check that a worker which is killed on the way gives the rollouts of this process; return what it ran in."""
    library, expert = motions(), Expert(G1)
    start = {name: value.clone() for name, value in expert.state_dict().items()}
    runs = []
    for workers in (0, 1):
        expert.load_state_dict(start)
        torch.manual_seed(1)
        given = options if workers else {}
        with collect(make_tracking_env, library, 3, expert.actor(), 40, workers=workers, **given) as source:
            parts = []
            for number in range(3):
                parts.append((next(source), source.statistics()))
                torch.rand(3)  # the caller draws from the same stream
                with torch.no_grad():
                    for parameter in expert.parameters():
                        parameter.add_(0.02 * torch.randn_like(parameter))
                if workers and number == 1:
                    kill(source, 0)
            runs.append((parts, torch.get_rng_state()))
    (in_process, random), (in_worker, random_after) = runs
    assert any(rollout["next", "done"].any() for rollout, _ in in_process)
    for (found, statistics), (wanted, expected) in zip(in_worker, in_process, strict=True):
        assert_same(found, wanted)
        assert statistics == expected
    assert torch.equal(random, random_after)
    return source


@pytest.mark.slow
def test_one_worker_is_as_one_process_even_if_it_is_killed(capsys):
    source = check_one_worker_is_as_one_process(kill)
    assert "worker 0 ended" in capsys.readouterr().out
    assert not source._host.errors.exists()


@pytest.mark.slow
def test_two_workers_ahead_of_the_learner_go_on_from_a_state(tmp_path):
    policy = flailing()
    torch.manual_seed(1)
    with collect(make_tracking_env, motions(), 5, policy, 20, workers=2, ahead=True) as source:
        assert isinstance(source, WorkerRollouts)
        first = next(source)
        assert first.shape == (5, 20)
        assert (first["action"].std((1, 2)) > 2).all()
        assert not torch.equal(first["action"][0], first["action"][3])  # the first robots of two streams
        with torch.no_grad():
            policy.module.scale.fill_(0.0)
        kill(source, 1)  # in the midst of the rollout that is simulated ahead
        second = next(source)
        assert (second["action"].std((1, 2)) > 2).all()  # begun before the weights changed
        going = ~first["next", "done"][:, -1, 0]
        ended, begun = first["next", "motion", "frame"][:, -1], second["motion", "frame"][:, 0]
        assert going.any()
        assert torch.equal(begun[going], ended[going])
        assert source.statistics()["terminated"] > 0
        torch.save(source.state_dict(), tmp_path / "state")
        third = next(source)
        assert (third["action"] == 0).all()
        with torch.no_grad():
            policy.module.scale.fill_(1.0)
        next(source)
        source.load_state_dict(torch.load(tmp_path / "state", weights_only=True))
        assert_same(next(source), third)  # with the weights that it was begun with
        with pytest.raises(StateError, match="a state of no workers, expected 2"):
            source.load_state_dict({"robots": {}})
    with pytest.raises(StateError, match="a state of worker processes"):
        Rollouts(make_tracking_env(motions(), 1), policy, 1).load_state_dict({"workers": []})


def test_one_worker_ahead_of_the_learner_has_a_stream_of_its_own():
    policy = flailing()
    torch.manual_seed(1)
    with collect(make_tracking_env, motions(), 3, policy, 20, workers=1, ahead=True) as source:
        before = torch.get_rng_state()
        first = next(source)
        with torch.no_grad():
            policy.module.scale.fill_(0.0)
        assert (next(source)["action"].std((1, 2)) > 2).all()  # begun before the weights changed
        assert (next(source)["action"] == 0).all()
        assert torch.equal(torch.get_rng_state(), before)
    assert (first["action"].std((1, 2)) > 2).all()


def test_robots_move_into_a_worker_and_back():
    policy = flailing()
    torch.manual_seed(1)
    with collect(make_tracking_env, motions(), 3, policy, 20) as here:
        last = next(here)
        state = here.state_dict()
        with collect(make_tracking_env, motions(), 3, policy, 20, workers=1, ahead=True) as there:
            there.load_state_dict(state)
            moved = next(there)
            back = there.state_dict()
            torch.manual_seed(2)  # a checkpoint that is later restores another state of the caller's stream
            there.load_state_dict(state)
            assert not torch.equal(next(there)["action"], moved["action"])
            if (status := Path(f"/proc/{there._workers[0]._collector.procs[0].pid}/status")).exists():
                (blocked,) = re.findall(r"SigBlk:\s*(\w+)", status.read_text())
                assert int(blocked, 16) >> (signal.SIGINT - 1) & 1, "Ctrl-C is not for a worker"
        going = ~last["next", "done"][:, -1, 0]
        assert going.any()
        assert torch.equal(moved["robot", "joint_pos"][going, 0], last["next", "robot", "joint_pos"][going, -1])
        here.load_state_dict(back)
        again = next(here)
        going = ~moved["next", "done"][:, -1, 0]
        assert torch.equal(again["robot", "joint_pos"][going, 0], moved["next", "robot", "joint_pos"][going, -1])
    two = collect(make_tracking_env, motions(), 3, policy, 20, workers=2)
    with two, pytest.raises(StateError, match="a state of no workers, expected 2"):
        two.load_state_dict(state)


class Ending(Processes):
    """Where workers end at once, or raise plat's errors."""

    def __init__(self, error: Exception):
        super().__init__()
        self.error = error
        self.started = 0

    def launch(self, job: Job) -> "Ending":
        self.started += 1
        return self

    def __iter__(self):
        return iter(())

    def map_fn(self, name: str, arguments: list[tuple[object, ...]]):
        raise self.error

    def shutdown(self) -> None:
        pass


def test_a_worker_that_cannot_be_kept_running_is_one_line():
    host = Ending(RuntimeError("worker 0 (exit code -9)\nmore"))
    with pytest.raises(WorkerError, match=r"worker 0 of 1 ended 3 times .* \(worker 0 \(exit code -9\)\)"):
        WorkerRollouts(make_tracking_env, motions(), 2, flailing(), 1, host=host)
    assert host.started == 3
    host = Ending(MotionError("too short"))
    with pytest.raises(MotionError, match="too short"):
        WorkerRollouts(make_tracking_env, motions(), 1, flailing(), 1, host=host)
    assert host.started == 1
    with pytest.raises(ConfigError, match="3 workers for 2 robots"):
        WorkerRollouts(make_tracking_env, motions(), 2, flailing(), 1, workers=3)
    with pytest.raises(ConfigError, match="--ray: expected workers"):
        collect(make_tracking_env, motions(), 2, flailing(), 1, ray=True)


def test_errors_of_plat_come_out_of_a_worker(tmp_path):
    def broken(*_: object, **options: object):
        raise MotionError("clip 'a': too short")

    job = Job(
        in_folder(tmp_path, motions(), broken, flailing(), "auto"), 1, 2, 3, num_threads=1, random=0, errors=tmp_path
    )
    assert job.reported() is None
    with as_worker(), pytest.raises(MotionError):
        job.environment()
    error = job.reported()
    assert isinstance(error, MotionError)
    assert str(error) == "clip 'a': too short"


def test_a_worker_refuses_a_policy_for_another_timing(tmp_path):
    policy = PlainPolicy(G1, PlainPolicyConfig(timing=Timing(max_steps=150))).deployed()
    content = in_folder(tmp_path, motions(), make_keyframe_env, policy, "auto")
    job = Job(content, 1, 2, 3, num_threads=1, random=0, errors=tmp_path)
    with as_worker(), pytest.raises(ConfigError, match="max_steps=150"):
        job.environment()
    assert isinstance(job.reported(), ConfigError)


@contextmanager
def as_worker():
    """What a worker does to its process, undone."""
    before = signal.getsignal(signal.SIGINT), torch.get_num_threads()
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before[0])
        torch.set_num_threads(before[1])


def test_motions_are_mapped_from_their_file(tmp_path):
    library = motions()
    content = in_folder(tmp_path, library, partial(make_tracking_env), flailing(), "auto")
    mapped, _, policy, _ = content()
    assert torch.equal(mapped.poses(torch.arange(9))["keypoint_pos"], library.poses(torch.arange(9))["keypoint_pos"])
    assert content()[2] is policy  # the environment's and the collector's are one
    maps = Path("/proc/self/maps")
    if maps.exists():
        assert str(tmp_path / "motions.pt") in maps.read_text()
    _from_folder.cache_clear()


@pytest.mark.parametrize("full", [True, False])
def test_a_disk_that_takes_no_motions_is_one_line(tmp_path, monkeypatch, full):
    def save(content: object, place: object, **options: object) -> None:
        if isinstance(place, Path):
            raise RuntimeError("[enforce fail at inline_container.cc:672] . unexpected pos 64 vs 0\nframe #0")
        saved(content, place, **options)

    saved = torch.save
    monkeypatch.setattr(torch, "save", save)
    monkeypatch.setattr(worker, "is_full", lambda folder: full)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    with pytest.raises(OutputError) as told:
        WorkerRollouts(make_tracking_env, motions(), 2, flailing(), 1)
    reason = "no space left on device" if full else "[enforce fail at inline_container.cc:672] . unexpected pos 64 vs 0"
    assert f"({reason}): set TMPDIR to a folder with more room" in str(told.value)
    assert f"motions for the workers cannot be written to '{tmp_path}/plat-workers-" in str(told.value)
    assert not list(tmp_path.iterdir())


def test_statistics_are_means_over_robots_and_counts_are_sums():
    gathered = [(3, {"speed": 1.0, "broken": 1.0}), (1, {"speed": 2.0, "broken": 2.0})]
    assert _merged(gathered) == {"speed": 1.25, "broken": 3.0}
