import pytest

from plat.errors import BundleError
from plat.export.facts import describe_policy
from plat.keyframes import MAX_STEPS
from tests.export.runs import KINDS, small_policy, write_run

TABLE = """policy,horizon,metric,value,low,high
run,long,tks,99.5,99.25,99.75
other,long,tks,1,1,1
run,long,mpjpe,0.1,0.09,0.11
"""


@pytest.mark.parametrize("kind", KINDS)
def test_latent_and_residual_of_each_kind(tmp_path, kind):
    policy = small_policy(kind)
    facts = describe_policy(policy, write_run(tmp_path / "run", policy))
    assert facts.policy.kind == kind.removesuffix("_with_lead")
    assert facts.policy.latent_size == (None if kind == "plain" else 8)
    assert facts.policy.residual_alpha == (0.7 if kind.startswith("residual") else None)
    assert facts.max_steps == MAX_STEPS
    assert (facts.training.run, facts.training.recipe, facts.training.commit) == ("run", "refine", "abc")
    assert facts.scores is None


def test_scores_are_those_of_the_run(tmp_path):
    policy = small_policy("plain")
    run = write_run(tmp_path / "run", policy)
    (run / "evaluation.csv").write_text(TABLE)
    scores = describe_policy(policy, run).scores
    assert [(score.horizon, score.metric, score.value, score.low, score.high) for score in scores] == [
        ("long", "tks", 99.5, 99.25, 99.75),
        ("long", "mpjpe", 0.1, 0.09, 0.11),
    ]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (TABLE.replace("run,", "plat,"), "no row of the policy 'run'"),
        (TABLE.replace("99.5", "many"), "not a table of recipes/evaluate.py --csv"),
        ("a,b\n1,2\n", "not a table of recipes/evaluate.py --csv"),
        ("", "no row of the policy 'run'"),
    ],
)
def test_a_table_that_is_none(tmp_path, table, message):
    policy = small_policy("plain")
    run = write_run(tmp_path / "run", policy)
    (run / "evaluation.csv").write_text(table)
    with pytest.raises(BundleError, match=f"evaluation.csv': {message}"):
        describe_policy(policy, run)
