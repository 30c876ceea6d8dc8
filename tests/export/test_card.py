import dataclasses

import pytest

from plat.deploy import Bundle, BundleScore
from plat.export.card import model_card
from plat.export.facts import describe_policy
from plat.runs import SavedRun
from tests.export.runs import small_policy, write_run


@pytest.fixture
def run(tmp_path) -> SavedRun:
    return SavedRun(write_run(tmp_path / "chaser", small_policy("residual_latent")))


@pytest.fixture
def bundle(run) -> Bundle:
    return describe_policy(run.policy(), run)


@pytest.fixture
def card(run, bundle):
    """The card of a run with some settings, whose bundle may have further fields and files."""

    def made(files=(), scores=None, **settings: object) -> str:
        run.config["recipe"]["settings"] = {"motions": ["clips.npz"], **settings}
        return model_card(dataclasses.replace(bundle, scores=scores), run, 3e-7, files)

    return made


def test_says_what_it_is_and_where_it_comes_from(card):
    text = card()
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


def test_says_whether_keyframes_may_be_partial(run, bundle):
    assert "to one future whole-body pose, at most" in model_card(bundle, run, 3e-7)
    parts = dataclasses.replace(bundle, also=("parts", "clock"))
    assert "to one future pose, whole or in part, at most" in model_card(parts, run, 3e-7)


def test_a_table_of_scores(card):
    scores = (
        BundleScore("long", "tks", 99.5, 99.25, 99.75),
        BundleScore("long", "mpjpe", 0.1, 0.09, 0.11),
        BundleScore("mixed", "mpkpe", 0.048, 0.0441, 0.0512),
    )
    text = card(scores=scores)
    assert "| commands | TKS@3 (%) | MPJPE@3 (rad) | MPKPE@3 (mm) |" in text
    assert "| long | 99.5 (99.2-99.8) | 0.100 (0.090-0.110) | - |" in text
    assert "| mixed | - | - | 48 (44-51) |" in text
    assert "no `evaluation.csv` in the run directory" in card()
    of_one_motion = (BundleScore("long", "tks", 100.0, 100.0, 100.0),)
    assert "| long | 100.0 | - | - |" in card(scores=of_one_motion)
    missed = (BundleScore("single", "tks", 99.97, 99.93, 100.0), BundleScore("single", "mpkpe", 0.00001, 0.0, 0.0001))
    assert "| single | 99.9 (99.9-100.0) | - | 0 (0-0) |" in card(scores=missed)  # some were missed


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
def test_limits_follow_from_the_training(card, task, sentence):
    assert sentence in card(task=task)


@pytest.mark.parametrize(("strength", "sentence"), [(0.0, "without observation noise and domain"), (0.5, "Scored in")])
def test_limits_of_what_learned_by_imagination(card, strength, sentence):
    assert sentence in card(disturbed=strength, task={"authored": 0.5})


def test_data_sets_have_their_licenses_by_name(card):
    text = card(motions=["/home/me/bandai_train.npz", "generated:train@60", "mine.npz", r"C:\me\hard_free_train.npz"])
    assert "| `bandai_train.npz` | Bandai-Namco Research Motion Dataset 1 and 2" in text
    assert "G1, by the file's name | CC BY-NC 4.0 |" in text
    assert "| `generated:train@60` | motions that plat generates | Apache-2.0 |" in text
    assert "| `mine.npz` | unknown to plat | unknown: ask who made them |" in text
    assert "me/" not in text
    assert "me\\" not in text
    (free,) = (line for line in text.splitlines() if line.startswith("| `hard_free_train.npz`"))
    for credit in ("mocap.cs.cmu.edu", "Jasmine Coro", "Mike Gassaway", "100STYLE (Ian Mason", "CC BY 4.0"):
        assert credit in free
    assert (
        "The license of some of these motions is unknown. The strictest of the others, if the names of the files are "
        "right: CC BY-NC 4.0." in text
    )


@pytest.mark.parametrize(
    ("motions", "told"),
    [
        (["asap.npz", "bandai.npz", "hard_sa.npz"], "these licenses, if the names of the files are right: CC BY-NC"),
        (["generated:val@9"], "The strictest of these licenses: Apache-2.0."),
        (["mine.npz"], "Their licenses are unknown."),
        (["generated_by_me.npz", "asapresults.npz", "asap_mine.npz", "my_bandai.npz"], "Their licenses are unknown."),
    ],
)
def test_what_the_names_of_files_do_not_tell_is_not_claimed(card, motions, told):
    assert told in card(motions=motions)


def test_a_picture_and_a_scene_are_named_where_they_are(card):
    assert "picture.png" not in card()
    assert "scene.xml" not in card()
    text = card(["scene.xml", "picture.png"])
    assert "](picture.png)" in text
    assert "`scene.xml`" in text
