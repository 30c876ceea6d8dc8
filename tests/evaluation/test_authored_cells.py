from dataclasses import replace
from functools import partial

import pytest
import torch

from plat.baselines import tuned_robot
from plat.control.authored import author
from plat.errors import ActionError, RecordsError
from plat.evaluation import Entrant, EvaluationSetting, authored_cells
from plat.evaluation.authored_cells import authored_groups, authored_records, records_of_all
from plat.evaluation.authored_rollout import Pushes
from plat.evaluation.authored_scores import AuthoredRecords, AuthoredScore
from plat.evaluation.cells import Candidate
from plat.evaluation.records import write_columns
from plat.modules import Expert, ExpertConfig
from plat.motions import MotionLibrary
from plat.robots import G1
from plat.spec.timing import Timing
from tests.conftest import standing_clip
from tests.evaluation.authored import authored_records as made_up

SETTING = EvaluationSetting(num_threads=1)


@pytest.fixture
def tracker() -> tuple[Candidate, Entrant]:
    entrant = Entrant.of_policy(Expert(G1, ExpertConfig(hidden=(8,))))
    return Candidate("expert", partial(dict), "weights"), entrant


@pytest.fixture
def motions() -> MotionLibrary:
    return MotionLibrary.from_clips([standing_clip(frames=30)])


def test_actions_that_are_not_finite_are_told_with_the_name_of_the_policy(tracker, motions):
    candidate, entrant = tracker
    for weights in entrant.policy.parameters():
        weights.data.fill_(torch.nan)
    with pytest.raises(ActionError, match="^expert: the policy gave robot 0 the action nan for joint 0"):
        authored_records(candidate, entrant, motions, 1, SETTING, chains=author("arms", G1, 1, 0))


def test_records_are_kept_and_taken_up_again(tracker, motions, tmp_path, monkeypatch, capsys):
    calls: list[int] = []

    def evaluate(policy, robot, chains, **options):
        calls.append(len(chains))
        return made_up()

    def chains(robot, motions, count, seed, timing):
        return author("arms", robot, count, seed)

    monkeypatch.setattr(authored_cells, "evaluate_authored", evaluate)
    monkeypatch.setattr(authored_cells, "author_families", chains)
    first = authored_records(*tracker, motions, 1, SETTING, tmp_path)
    again = authored_records(*tracker, motions, 1, SETTING, tmp_path)
    assert len(calls) == 1
    assert again.family == first.family
    assert torch.equal(again.reached, first.reached)
    assert "evaluated again" not in capsys.readouterr().out
    authored_records(*tracker, motions, 1, replace(SETTING, seed=1), tmp_path)  # other chains
    candidate, entrant = tracker
    authored_records(replace(candidate, fingerprint="other"), entrant, motions, 1, SETTING, tmp_path)
    assert len(calls) == 3
    told = capsys.readouterr().out.splitlines()
    assert [line.rpartition(" of ")[2] for line in told if "replaced" in line] == [
        "other keyframes",
        "another policy, other keyframes",
    ]
    for _ in range(2):
        authored_records(*tracker, motions, 1, SETTING, tmp_path / "pushed", pushes=Pushes(0.2))
    authored_records(*tracker, motions, 1, SETTING, tmp_path / "pushed", pushes=Pushes(0.3))
    assert len(calls) == 5
    (tmp_path / "expert-authored.safetensors").write_bytes(b"nonsense")
    authored_records(*tracker, motions, 1, SETTING, tmp_path)
    assert len(calls) == 6


def test_chains_are_drawn_once_for_all_that_are_alike(tracker, motions, monkeypatch):
    candidate, entrant = tracker
    drawn: list[int] = []

    def chains(robot, motions, count, seed, timing):
        drawn.append(count)
        return author("arms", robot, count, seed)

    monkeypatch.setattr(authored_cells, "evaluate_authored", lambda *_, **__: made_up())
    monkeypatch.setattr(authored_cells, "author_families", chains)
    other = replace(candidate, name="other")
    found = dict(records_of_all({candidate: entrant, other: entrant}, motions, 2, SETTING))
    assert list(found) == [candidate, other]
    assert drawn == [2]


def test_a_policy_of_short_commands_is_left_out(motions, capsys):
    short = Entrant.of_policy(Expert(G1, ExpertConfig(hidden=(8,), timing=Timing(max_steps=25))))
    candidate = Candidate("short", partial(dict), "weights")
    assert list(records_of_all({candidate: short}, motions, 1, SETTING)) == []
    told = "short: no authored keyframes, which are up to 1 s apart: its longest command is 0.5 s"
    assert capsys.readouterr().out.strip() == told
    with pytest.raises(RecordsError, match=told):
        authored_records(candidate, short, motions, 1, SETTING)


def test_a_file_of_other_records_is_refused(tmp_path):
    made_up().save(tmp_path / "a.safetensors", {})
    records, about = AuthoredRecords.load(tmp_path / "a.safetensors")
    assert (records.family, about) == (made_up().family, {})
    write_columns(tmp_path / "b.safetensors", {"reached": torch.zeros(1)}, {})
    with pytest.raises(RecordsError, match=r"b.safetensors': not a file of authored records"):
        AuthoredRecords.load(tmp_path / "b.safetensors")


def test_scores_by_family():
    arms, far = authored_groups("PLAT", made_up())
    assert (arms.group, arms.count, arms.figures["reached"].value, arms.figures["fell"].value) == ("arms", 2, 100, 0)
    assert (far.group, far.figures["reached"].value, far.figures["fell"].value) == ("far", 0, 100)
    assert far.figures["reached"].low == AuthoredScore.of(made_up(), "far").reached[1]


@pytest.mark.parametrize("interface", ["next-frame", "line", "cascade"])
def test_a_dense_tracker_is_led_by_its_interface(interface, monkeypatch):
    """What it is shown in the first step lies the nearer, the less the interface asks of it."""
    expert = Expert(G1, ExpertConfig(hidden=(8,)))
    entrant = Entrant.of_policy(expert, interface=interface)
    shown: list[torch.Tensor] = []

    class SeenError(Exception):
        """The first step is enough."""

    def forward(self, tensordict, *rest, **options):
        shown.append((tensordict["goal", "joint_pos"] - tensordict["state", "joint_pos"]).abs().amax(-1))
        raise SeenError

    monkeypatch.setattr(type(entrant.policy), "forward", forward)
    chains = [replace(chain, hold=0.1) for chain in author("arms", G1, 1, seed=0)]
    observe = entrant.view.keyframes().transforms
    with pytest.raises(SeenError):
        authored_cells.evaluate_authored(entrant.policy, G1, chains, observe=observe, num_threads=1)
    far = float(shown[0].max())
    assert far > 0.2 if interface == "next-frame" else far < 0.1


def test_records_of_another_robot_are_not_used(tracker, tmp_path, monkeypatch):
    calls: list[str] = []

    def chains(robot, motions, count, seed, timing):
        return author("arms", robot, count, seed)

    def evaluate(policy, robot, chains, **options):
        calls.append(robot.name)
        return made_up()

    monkeypatch.setattr(authored_cells, "evaluate_authored", evaluate)
    monkeypatch.setattr(authored_cells, "author_families", chains)
    candidate, entrant = tracker
    # a tracker has the G1 with motors of its own
    tuned = tuned_robot(G1, "tuned", 0.5 * G1.stiffness, G1.damping, G1.effort_limit)
    for robot in (G1, replace(G1, name="mine", root_height=0.7), replace(G1, name="mine", root_height=0.7)):
        motions = MotionLibrary.from_clips([standing_clip(frames=30)], robot=robot)
        list(records_of_all({candidate: replace(entrant, robot=tuned)}, motions, 1, SETTING, tmp_path))
        _, about = AuthoredRecords.load(tmp_path / "expert-authored.safetensors")
        assert ("robot" in about) == (robot is not G1)
    assert calls == ["tuned", "tuned"]
