from pathlib import Path

import pytest

from plat.recipes.options import ExpertRecipe, ImagineRecipe
from plat.runs.changes import changes, settings_of, with_defaults


@pytest.mark.parametrize(
    "name",
    [
        *("steps", "minutes", "out", "device", "lr", "init_lr", "ppo.min_lr", "imagination.model_lr", "unseen", "ray"),
        "imagination.policy_muon",
    ],
)
def test_what_may_change(name):
    assert changes(nested(name, 1), nested(name, 2), {}) == ({name: (1, 2)}, {})


@pytest.mark.parametrize("name", ["seed", "num_envs", "policy.hidden", "policy.timing.control_dt", "task.noise", "clr"])
def test_what_may_not_change(name):
    assert changes(nested(name, 1), nested(name, 2), {}) == ({}, {name: (1, 2)})


@pytest.mark.parametrize(("before", "now", "may"), [(0, 1, True), (1, 0, True), (1, 2, False), ([], 1, False)])
def test_one_worker_takes_the_place_of_none(before, now, may):
    found = changes({"workers": before}, {"workers": now}, {})
    assert (found.free if may else found.refused) == {"workers": (before, now)}
    assert not (found.refused if may else found.free)


def nested(name: str, value: object) -> dict:
    first, _, rest = name.partition(".")
    return {first: nested(rest, value) if rest else value}


def test_paths_may_change_where_their_content_is_compared():
    before, now = {"motions": ["a.npz"], "expert": "runs/a"}, {"motions": ["b.npz"], "expert": "runs/b"}
    assert changes(before, now, {"motions": []}).refused == {"expert": ("runs/a", "runs/b")}
    assert changes(before, now, {"motions": [], "expert": ""}).refused == {}
    assert changes({"init": None}, {"init": "runs/a"}, {"init": ""}).refused == {"init": (None, "runs/a")}


def test_fields_of_another_version_do_not_count():
    assert changes({"old": 1, "same": {"x": 1}}, {"new": 1, "same": {"x": 1}}, {}) == ({}, {})
    assert changes({"noise": None}, {"noise": {"x": 1}}, {}).refused == {"noise": (None, {"x": 1})}


def test_settings_that_a_run_lacks_are_the_defaults():
    recipe = ImagineRecipe(motions=("a.npz",), out=Path("a"), seed=3)
    before = with_defaults({"old": 1, "task": {"authored": 0.25}, "policy": None}, recipe)
    assert (before["old"], before["seed"], before["init"], before["policy"]) == (1, 0, None, None)
    assert before["task"] == {**settings_of(recipe)["task"], "authored": 0.25}
    assert before["imagination"] == settings_of(recipe)["imagination"]
    assert "out" not in before, "it has no default"


def test_defaults_are_written_as_settings_are():
    recipe = ExpertRecipe(motions=("a.npz",), out=Path("a"))
    assert changes(with_defaults({}, recipe), settings_of(recipe), {}) == ({}, {})
