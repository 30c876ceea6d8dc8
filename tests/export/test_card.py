import dataclasses

import pytest

from plat.deploy import Bundle, BundleScore
from plat.export.card import model_card
from plat.export.facts import describe_policy
from plat.runs import SavedRun
from tests.export.runs import small_policy, write_run


@pytest.fixture
def bundle(tmp_path) -> Bundle:
    policy = small_policy("residual_latent")
    return describe_policy(policy, SavedRun(write_run(tmp_path / "chaser", policy)))


def card(bundle: Bundle, **task: object) -> str:
    return model_card(bundle, {"motions": ["clips.npz"], "task": task}, 3e-7)


def test_says_what_it_is_and_where_it_comes_from(bundle):
    text = card(bundle)
    for part in (
        "# chaser",
        "g1 (29 joints)",
        "at most 1 s",
        "`plat refine`",
        "commit abc",
        "`clips.npz`",
        "3e-07",
    ):
        assert part in text


def test_a_table_of_scores(bundle):
    scores = (
        BundleScore("long", "tks", 99.5, 99.25, 99.75),
        BundleScore("long", "mpjpe", 0.1, 0.09, 0.11),
        BundleScore("mixed", "mpkpe", 0.048, 0.0441, 0.0512),
    )
    text = card(dataclasses.replace(bundle, scores=scores))
    assert "| commands | TKS@3 (%) | MPJPE@3 (rad) | MPKPE@3 (mm) |" in text
    assert "| long | 99.5 (99.2-99.8) | 0.100 (0.090-0.110) | - |" in text
    assert "| mixed | - | - | 48 (44-51) |" in text
    assert "no `evaluation.csv` in the run directory" in card(bundle)


@pytest.mark.parametrize(
    ("task", "sentence"),
    [
        ({"noise": None, "randomization": None}, "without observation noise and domain random"),
        ({"noise": None, "randomization": {"encoder_bias": 0.01}}, "Trained without observation noise:"),
        ({"noise": {"joint_pos": 0.01}, "randomization": {"encoder_bias": 0.01}}, "Scored in simulation only."),
        # as version 0.1 wrote it
        ({"observation_noise": False, "domain_randomization": False}, "without observation noise and domain random"),
        ({"observation_noise": True, "domain_randomization": False}, "Trained without domain randomization:"),
        ({"observation_noise": True, "domain_randomization": True}, "Scored in simulation only."),
    ],
)
def test_limits_follow_from_the_training(bundle, task, sentence):
    assert sentence in card(bundle, **task)


@pytest.mark.parametrize(("strength", "sentence"), [(0.0, "without observation noise and domain"), (0.5, "Scored in")])
def test_limits_of_what_learned_by_imagination(bundle, strength, sentence):
    settings = {"motions": ["clips.npz"], "disturbed": strength, "task": {"authored": 0.5}}
    assert sentence in model_card(bundle, settings, 0.0)


def test_data_sets_have_their_licenses_by_name(bundle):
    text = model_card(bundle, {"motions": ["/home/me/bandai_train.npz", "generated:train@60", "mine.npz"]}, 0.0)
    assert "| `bandai_train.npz` | Bandai-Namco Research Motion Dataset 1 and 2" in text
    assert "| CC BY-NC 4.0 |" in text
    assert "| `generated:train@60` | motions that plat generates | Apache-2.0 |" in text
    assert "| `mine.npz` | not known to plat | ask who made them |" in text
    assert "/home/me" not in text
    assert "strictest of these licenses: ask who made them." in text
    text = model_card(bundle, {"motions": ["asap.npz", "bandai.npz", "hard_sa.npz"]}, 0.0)
    assert "strictest of these licenses: CC BY-NC 4.0." in text


def test_a_picture_and_a_scene_are_named_where_they_are(bundle):
    assert "picture.png" not in card(bundle)
    assert "scene.xml" not in card(bundle)
    text = model_card(bundle, {}, 0.0, ["scene.xml", "picture.png"])
    assert "](picture.png)" in text
    assert "`scene.xml`" in text
