import sys

import pytest

from plat.cli import COMMANDS, main
from plat.cli.candidates import candidates_of
from plat.cli.options import ReleasedTrackers
from plat.errors import ConfigError
from plat.modules import LatentPolicy
from plat.robots import G1
from plat.runs import policies
from plat.runs.user_modules import import_modules
from tests.cli.settings import settings_of
from tests.modules.policies.test_student import SMALL
from tests.recipes.runs import save_run, write_motions

MODULE = """
from plat.modules import LatentPolicy, LatentPolicyConfig
from plat.runs import register_policy


class Mine(LatentPolicy):
    pass


register_policy("mine", Mine, LatentPolicyConfig)
"""


def test_a_run_of_a_users_class_is_evaluated(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(policies, "_KINDS", dict(policies._KINDS))
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    run = save_run(tmp_path / "run", LatentPolicy(G1, SMALL))
    config = run / "config.json"
    config.write_text(config.read_text().replace('"latent"', '"mine"'))
    arguments = ["evaluate", str(run), "--motions", write_motions(tmp_path), "--horizon", "long", "--device", "cpu"]
    with pytest.raises(SystemExit, match=r"unknown kind of policy 'mine', expected one of .*--import MODULE"):
        main(arguments)
    (tmp_path / "my_policies.py").write_text(MODULE)
    try:
        main([*arguments, "--import", "json", "--import", "my_policies"])
    finally:
        sys.modules.pop("my_policies", None)
    assert "long" in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_that_load_policies_import_modules(command):
    names = {name for name, _ in settings_of(command)}
    loads = names & {"run", "runs", "policy", "init", "init_model", "expert", "student"} and command != "curves"
    assert "imports" in names or not loads


def test_runs_of_a_users_class_are_averaged(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(policies, "_KINDS", dict(policies._KINDS))
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    for name in ("a", "b"):
        config = save_run(tmp_path / name, LatentPolicy(G1, SMALL)) / "config.json"
        config.write_text(config.read_text().replace('"latent"', '"mine"'))
    (tmp_path / "my_policies.py").write_text(MODULE)
    try:
        main(["average", "a", "b", "--out", "mean", "--import", "my_policies"])
    finally:
        sys.modules.pop("my_policies", None)
    assert capsys.readouterr().out.endswith("plat evaluate a b mean --motions test.npz --import my_policies\n")


@pytest.mark.parametrize("command", ["expert", "expert-model", "imagine", "distill", "refine", "refine-model"])
def test_stages_import_modules_first(tmp_path, command):
    words = [*("--motions", "generated:val@4", "--out", str(tmp_path / "out"), "--steps", "1"), "--import", "no_such"]
    words += {"distill": ["--expert", "x"], "refine": ["--student", "x"], "refine-model": ["--student", "x"]}.get(
        command, []
    )
    with pytest.raises(SystemExit, match=r"^error: --import no_such: ModuleNotFoundError"):
        main([command, *words])
    assert not (tmp_path / "out").exists()


def test_records_of_other_code_are_other_records(tmp_path, monkeypatch):
    """Scores that were kept in --out were those of the code before it was changed."""
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setattr("plat.runs.user_modules._imported", set())
    run = save_run(tmp_path / "run", LatentPolicy(G1, SMALL))

    def mark() -> str:
        (candidate,) = candidates_of((run,), ReleasedTrackers())
        return candidate.fingerprint

    before = mark()
    package = tmp_path / "my_package"
    package.mkdir()
    for file, text in (("__init__.py", "from my_package import inner"), ("inner.py", "GAIN = 1.0")):
        (package / file).write_text(text)
    try:
        import_modules(["my_package"])
        with_code = mark()
        assert with_code == mark() != before
        (package / "inner.py").write_text("GAIN = 0.0")
        assert mark() != with_code
    finally:
        for name in ("my_package", "my_package.inner"):
            sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("text", "message"), [(None, "ModuleNotFoundError: No module named 'my_broken'"), ("1 / 0", "ZeroDivisionError")]
)
def test_a_module_that_fails_is_named(tmp_path, monkeypatch, text, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    if text:
        (tmp_path / "my_broken.py").write_text(text)
    with pytest.raises(ConfigError, match=f"--import my_broken: {message}") as error:
        import_modules(["my_broken"])
    assert "\n" not in str(error.value)
