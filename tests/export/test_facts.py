import pytest
import torch
from tensordict.nn import TensorDictModule

from plat.export.facts import describe_policy
from plat.modules import PlainPolicyConfig
from plat.robots import G1
from plat.runs import SavedRun, register_policy, shipped_runs
from plat.runs.policies import _KINDS
from tests.export.runs import KINDS, small_policy, write_run

TABLE = """policy,horizon,metric,value,low,high
run,long,tks,99.5,99.25,99.75
other,long,tks,1,1,1
run,long,mpjpe,0.1,0.09,0.11
"""


@pytest.mark.parametrize("kind", KINDS)
def test_latent_and_residual_of_each_kind(tmp_path, kind):
    policy = small_policy(kind)
    facts = describe_policy(policy, SavedRun(write_run(tmp_path / "run", policy)))
    assert facts.policy.kind == kind.removesuffix("_with_lead")
    assert facts.policy.latent_size == (None if kind == "plain" else 8)
    assert facts.policy.residual_alpha == (0.7 if kind.startswith("residual") else None)
    assert facts.max_steps == 50
    assert (facts.training.run, facts.training.recipe, facts.training.commit) == ("run", "refine", "abc")
    assert facts.scores is None


def test_scores_are_those_of_the_run(tmp_path):
    policy = small_policy("plain")
    run = write_run(tmp_path / "run", policy)
    (run / "evaluation.csv").write_text(TABLE)
    scores = describe_policy(policy, SavedRun(run)).scores
    assert [(score.horizon, score.metric, score.value, score.low, score.high) for score in scores] == [
        ("long", "tks", 99.5, 99.25, 99.75),
        ("long", "mpjpe", 0.1, 0.09, 0.11),
    ]


@pytest.mark.parametrize("name", ["evaluation.csv", "../evaluation.csv"])
def test_scores_beside_the_run_travel_with_it(tmp_path, name):
    policy = small_policy("plain")
    run = write_run(tmp_path / "run", policy)
    (run / name).write_text(TABLE)
    assert [score.value for score in describe_policy(policy, SavedRun(run)).scores] == [99.5, 0.1]


def test_the_committed_policy_shows_its_scores():
    run = SavedRun(shipped_runs()["plat-g1"])
    scores = describe_policy(run.policy(), run).scores
    assert {"tks", "mpjpe", "mpkpe"} <= {score.metric for score in scores if score.horizon == "mixed"}


class OwnPolicy(torch.nn.Module):
    """Of a user: no latent, no normalizer, nothing of plat's."""

    def __init__(self, robot, config=None):
        super().__init__()
        self.robot, self.config = robot, config or PlainPolicyConfig()

    def deployed(self):
        return TensorDictModule(torch.nn.Identity(), [("goal", "joint_pos")], ["action"])


def test_a_registered_class_is_described(tmp_path, monkeypatch):
    monkeypatch.setattr("plat.runs.policies._KINDS", dict(_KINDS))
    register_policy("own", OwnPolicy, PlainPolicyConfig)
    policy = OwnPolicy(G1)
    facts = describe_policy(policy, SavedRun(write_run(tmp_path / "run", policy))).policy
    assert (facts.kind, facts.latent_size, facts.residual_alpha) == ("own", None, None)


def test_a_metric_without_a_case_is_left_out(tmp_path):
    policy = small_policy("plain")
    run = write_run(tmp_path / "run", policy)
    (run / "evaluation.csv").write_text(TABLE + "run,single,mpjpe,nan,nan,nan\n")
    facts = describe_policy(policy, SavedRun(run))
    assert [score.horizon for score in facts.scores] == ["long", "long"]
    facts.to_json()
