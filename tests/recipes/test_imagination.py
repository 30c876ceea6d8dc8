"""The recipes of imagination as a user runs them: killed, resumed, and what they make evaluated."""

import csv
import re
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from plat.cli import main
from plat.envs.randomized_physics import num_physics
from plat.envs.transforms import HORIZONS, CommandSchedule
from plat.errors import ConfigError
from plat.evaluation import evaluate
from plat.modules import (
    DynamicsConfig,
    DynamicsModel,
    Expert,
    ExpertConfig,
    FinetunedPolicy,
    LatentPolicy,
    PlainPolicy,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.motions import MotionLibrary, save_motions
from plat.recipes import expert_model, imagine, learning
from plat.robots import G1
from plat.runs import SavedRun, load_dynamics, load_policy, save_dynamics, write_json
from plat.runs.json_object import read_json
from tests.conftest import standing_clip
from tests.export.runs import small_policy, write_run
from tests.in_process import kill_plat, run, run_plat

ROOT = Path(__file__).parents[2]
SMALL = [
    # without the report of the model's error, which takes longer than these trainings: the first test sees to it
    *("--motions", "generated:val@30", "--unseen", "--num-envs", 8, "--replay", 64),
    *("--model.hidden", 16, 16, "--imagination.warmup", 1, "--imagination.steps", 3, "--imagination.window", 4),
    *("--imagination.model-batch", 16, "--imagination.policy-batch", 16, "--imagination.recent", 16),
]
RECIPES: dict[str, list[object]] = {
    "expert-model": [*SMALL, "--policy.hidden", 16],
    "imagine": [*SMALL, "--policy.backbone", 16, "--policy.decoder", 16, "--task.chains", 12],
}
REFINE: list[object] = [*SMALL, "--policy.hidden", 16, "--task.chains", 12]


def rows_of(table: Path) -> list[dict[str, str]]:
    with table.open(newline="") as file:
        return list(csv.DictReader(file))


def steps_in(folder: Path) -> list[int]:
    return [int(row["step"]) for row in rows_of(folder / "metrics.csv")]


@pytest.fixture
def short_report(monkeypatch) -> None:
    """Report the model's error on 2 s of each robot: on 8 s it takes longer than these trainings."""
    monkeypatch.setattr(learning, "REPORT_ROLLOUTS", 2)


@pytest.mark.parametrize("recipe", RECIPES)
def test_killed_resumed_and_evaluated(tmp_path, short_report, recipe):
    out = tmp_path / "run"
    arguments = [*RECIPES[recipe], "--out", out, "--save-every", 0]

    def ready() -> bool:
        return bool(list(out.glob("checkpoints/checkpoint-*"))) and len(steps_in(out)) >= 5

    kill_plat(ready, tmp_path / "printed.txt", recipe, *arguments, "--steps", 10**9)
    before = steps_in(out)
    text = run(recipe, *arguments, "--steps", before[-1] + 200, "--resume", "--unseen", "generated:val@8")
    assert 0 < int(re.search(r"resumed from .* at ([\d,]+) steps", text).group(1).replace(",", "")) <= before[-1]
    assert "model error after 48 steps" in text
    after = steps_in(out)
    assert after == sorted(set(after))
    rows = rows_of(out / "metrics.csv")
    assert float(rows[-1]["imagined_cost"]) > 0
    assert float(rows[-1]["model/loss"]) > 0
    assert len(rows_of(out / "model_error.csv")) == 48
    assert load_dynamics(out, G1).config.hidden == (16, 16)
    policy, clip = load_policy(out), MotionLibrary.from_clips([standing_clip()])
    if recipe == "expert-model":
        assert isinstance(policy, Expert)
        deployed = policy.deployed(tuple(policy.goals))
        records = evaluate(deployed, clip, HORIZONS["long"], seed=0, dense=True, goals=policy.goals)
    else:
        assert isinstance(policy, PlainPolicy)
        assert "authored_failures_per_second" in rows[-1]
        records = evaluate(policy.deployed(), clip, HORIZONS["long"], seed=0)
    assert len(records.failed) == CommandSchedule(clip, HORIZONS["long"], seed=0).num_commands


def test_a_seed_fixes_the_result(tmp_path):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        arguments = [*RECIPES["imagine"], "--out", tmp_path / name, "--steps", 192, "--seed", seed]
        main(["imagine", *map(str, arguments)])
    a, b, c = (load_file(tmp_path / name / "model.safetensors") for name in "abc")
    assert all(a[name].equal(b[name]) for name in a)
    assert not all(a[name].equal(c[name]) for name in a)


def test_overlapped_a_seed_fixes_the_result_and_a_resumed_run_is_the_same(tmp_path):
    words = [*RECIPES["imagine"], "--seed", 3, "--imagination.constant", 1]
    for name, overlap in (("a", True), ("b", False)):
        given = ["--out", tmp_path / name, "--steps", 192, *["--overlap"] * overlap]
        main(["imagine", *map(str, [*words, *given])])
    for steps in (64, 192):
        given = ["--out", tmp_path / "c", "--steps", steps, "--overlap", *["--resume"] * (steps > 64)]
        main(["imagine", *map(str, [*words, *given])])
    a, b, c = (load_file(tmp_path / name / "model.safetensors") for name in "abc")
    assert not all(a[name].equal(b[name]) for name in a)  # in an older model of the robot
    assert all(a[name].equal(c[name]) for name in a)
    whole, parted = (rows_of(tmp_path / name / "metrics.csv") for name in "ac")
    for row in (*whole, *parted):
        del row["seconds"]
    assert parted == whole
    assert all(value.isfinite().all() for value in a.values())


def test_a_run_goes_on_with_and_without_overlap(tmp_path):
    words = [*RECIPES["imagine"], "--out", out := tmp_path / "run", "--seed", 3]
    run("imagine", *words, "--steps", 64)
    for steps, after in ((128, True), (192, False)):
        text = run("imagine", *words, "--steps", steps, *["--overlap"] * after, "--resume")
        assert f"goes on with overlap {after} in place of {not after}" in text
        assert steps_in(out)[-1] == steps
        assert SavedRun(out).settings["overlap"] == after


def test_no_robots_on_a_gpu_are_simulated_beside():
    recipe = imagine.ImagineRecipe(motions=("generated:val@30",), out=Path("run"), steps=1, device="cpu", overlap=True)
    with pytest.raises(ConfigError, match="overlap is True, and physics 'warp' is on one device: expected overlap"):
        replace(recipe, physics="warp")


def test_the_model_of_an_expert_serves_a_keyframe_policy(tmp_path):
    expert, policy = tmp_path / "expert", tmp_path / "policy"
    run("expert-model", *RECIPES["expert-model"], "--out", expert, "--steps", 300)
    latent = ["--student", "latent", "--policy.prior", 16, "--policy.posterior", 16]
    # for robots of all kinds: the model is told which, and learns what to make of it
    disturbed = ["--disturbed", 1, "--init-model", expert, "--out", policy, "--steps", 100]
    run("imagine", *RECIPES["imagine"], *latent, *disturbed)
    assert isinstance(load_policy(policy), LatentPolicy)
    told = num_physics(G1)
    before, after = (load_dynamics(folder, G1, num_parameters=told).network[0].weight for folder in (expert, policy))
    assert (before[:, -told:] == 0).all()
    assert (after[:, -told:] != 0).any()
    assert 0 < float((before - after).detach().norm()) < 0.5 * float(torch.linalg.norm(before.detach()))


def test_a_privileged_posterior_learns_as_well(tmp_path):
    latent = [*("--student", "latent", "--policy.prior", 16, "--policy.posterior", 16, "--policy.latent-size", 4)]
    arguments = [*RECIPES["imagine"], *latent, "--posterior", 0.5, "--beta", 0.01, "--device", "cpu"]
    for name, steps in (("a", 80), ("b", 200)):
        main(["imagine", *map(str, [*arguments, "--out", tmp_path / name, "--steps", steps])])
    before, after = (load_policy(tmp_path / name).state_dict() for name in "ab")
    parts = ("posterior", "encoder", "prior", "decoder")
    moved = {part for part in parts if any(not after[n].equal(v) for n, v in before.items() if n.startswith(part))}
    assert moved == set(parts)
    assert float(rows_of(tmp_path / "b" / "metrics.csv")[-1]["kl"]) > 0
    plain = map(str, [*RECIPES["imagine"], "--posterior", 0.5, "--out", tmp_path / "c", "--steps", 8])
    with pytest.raises(SystemExit, match="a plain student has none"):
        main(["imagine", *plain])


@pytest.mark.parametrize(
    ("variant", "kind", "learns"),
    [
        ("latent", ResidualLatentPolicy, "residual"),
        ("action", ResidualActionPolicy, "residual"),
        ("finetune", FinetunedPolicy, "student"),
    ],
)
def test_a_student_is_refined(tmp_path, variant, kind, learns):
    student, out = tmp_path / "student", tmp_path / "run"
    before = small_policy("latent")
    write_run(student, before)
    arguments = [*REFINE, "--student", student, "--variant", variant, "--device", "cpu", "--out", out]
    main(["refine-model", *map(str, arguments), "--steps", "150"])
    policy = load_policy(out)
    assert isinstance(policy, kind)
    same = {name for name, value in before.state_dict().items() if policy.student.state_dict()[name].equal(value)}
    moved = set(before.state_dict()) - same
    # the normalizer stays as it is, and what is frozen does; the posterior is no part of the policy
    assert bool(moved) == (learns == "student")
    assert not any(name.startswith(("normalizer", "posterior", "encoder")) for name in moved)
    if learns == "residual":
        assert any((value != 0).any() for value in policy.residual.state_dict().values())


def test_fine_tuning_goes_on(tmp_path):
    write_run(tmp_path / "tuned", FinetunedPolicy(small_policy("latent"), RefinementConfig(lead=0.05)))
    again = [*REFINE, "--student", tmp_path / "tuned", "--variant", "finetune", "--device", "cpu", "--steps", 8]
    with pytest.raises(SystemExit, match=r"lead is 0 s, expected 0.05 s, with which .*tuned' was fine-tuned"):
        main(["refine-model", *map(str, again), "--out", str(tmp_path / "a")])
    main(["refine-model", *map(str, again), "--policy.lead", "0.05", "--out", str(tmp_path / "b")])
    before, after = (load_policy(tmp_path / name) for name in ("tuned", "b"))
    assert after.config.lead == 0.05
    for name, weight in before.student.state_dict().items():
        # 8 steps are before the first update
        assert after.student.state_dict()[name].equal(weight), name


def test_only_a_student_with_a_latent_is_refined(tmp_path):
    write_run(tmp_path / "plain", small_policy("plain"))
    arguments = [*REFINE, "--student", tmp_path / "plain", "--out", tmp_path / "x", "--steps", 8]
    with pytest.raises(SystemExit, match="plat imagine --student latent"):
        main(["refine-model", *map(str, arguments)])


def test_going_on_from_a_student_takes_its_shape(tmp_path):
    start, out = tmp_path / "start", tmp_path / "run"
    write_run(start, small_policy("plain"))
    arguments = [*SMALL, "--task.chains", 12, "--init", start, "--out", out]
    main(["imagine", *map(str, arguments), "--steps", "64"])
    assert load_policy(out).config == load_policy(start).config
    main(["imagine", *map(str, arguments), "--steps", "128", "--resume"])
    with pytest.raises(SystemExit, match="the trained policy has"):
        main(["imagine", *map(str, arguments), "--policy.backbone", "8", "--steps", "64", "--out", str(tmp_path / "x")])


def test_a_student_that_was_fine_tuned_can_be_gone_on_from(tmp_path):
    tuned, out = tmp_path / "tuned", tmp_path / "run"
    write_run(tuned, small_policy("finetuned"))
    arguments = ["imagine", *SMALL, "--task.chains", 12, "--student", "latent", "--init", tuned, "--out", out]
    main([*map(str, arguments), "--steps", "8"])  # before the first update
    student = load_policy(tuned).student
    assert load_policy(out).config == student.config
    for before, after in zip(student.parameters(), load_policy(out).parameters(), strict=True):
        torch.testing.assert_close(after, before)
    led = FinetunedPolicy(student, RefinementConfig(lead=0.1))
    arguments = [*arguments[:-4], "--init", write_run(tmp_path / "led", led), "--out", tmp_path / "other"]
    with pytest.raises(SystemExit, match=r"lead is 0 s, expected 0.1 s, with which .*led' was fine-tuned"):
        main([*map(str, arguments), "--steps", "64"])


def test_going_on_from_an_expert_takes_its_shape(tmp_path, capsys):
    start, out = tmp_path / "start", tmp_path / "run"
    config = ExpertConfig(hidden=(16,), action="reference_velocity", ahead=(1, 2), lead=0.085, catch_up=2.0)
    write_run(start, Expert(G1, config))
    arguments = ["expert-model", *map(str, [*SMALL, "--init", start, "--out"])]
    main([*arguments, str(out), "--steps", "64"])
    assert load_policy(out).config == config
    told = r"start' goes on in its shape: hidden .*, ahead .*, lead 0.085, catch_up 2.0\n"
    assert re.search(told, capsys.readouterr().out)
    main([*arguments, str(out), "--steps", "128", "--resume"])
    wider = [*arguments, str(tmp_path / "wider"), "--policy.hidden", "32", "--steps", "64"]
    main([*wider, "--policy.catch-up", "2.0"])
    assert "ahead (1, 2, 5, 10) in place of (1, 2), lead 0.0 in place of 0.085\n" in capsys.readouterr().out
    assert load_policy(tmp_path / "wider").config.catch_up == 2.0
    with pytest.raises(SystemExit, match=r"start': it sees frames .* \(--policy.ahead, --policy.hidden\)"):
        main([*arguments, str(tmp_path / "x"), "--policy.hidden", "8", "--steps", "64"])


@pytest.mark.parametrize("recipe", RECIPES)
def test_bad_input_is_one_clear_line(tmp_path, recipe):
    weights = ROOT / "plat" / "weights"
    for arguments, message in (
        (["--init-model", weights / "plat"], "dynamics.safetensors': no such file"),
        (["--init", weights / "plat"], "expected"),
    ):
        out = run_plat(recipe, *RECIPES[recipe], *arguments, "--steps", 10, "--out", tmp_path / "x")
        assert out.returncode == 1
        assert message in out.stderr
        assert "Traceback" not in out.stderr


@pytest.mark.parametrize("recipe", [expert_model, imagine])
def test_motions_have_the_control_step_of_the_policy(tmp_path, monkeypatch, recipe):
    seen = []
    monkeypatch.setattr(recipe, "learn", lambda _, library, *rest, **options: seen.append(library.dt))
    name = recipe.__name__.rpartition(".")[2].replace("_", "-")
    sizes = [str(argument) for argument in RECIPES[name]]
    about = ["--motions", "generated:val@8", "--policy.timing.control-dt", "0.04"]
    about += ["--device", "cpu", "--steps", "10", "--out", str(tmp_path / "run")]
    main([name, *sizes, *about])
    assert seen == [0.04]


QUICK: list[object] = [
    *("--motions", "generated:val@8", "--unseen", "--num-envs", 8, "--replay", 64, "--device", "cpu"),
    *("--imagination.warmup", 0, "--imagination.steps", 2, "--imagination.window", 4),
    *("--imagination.model-batch", 8, "--imagination.policy-batch", 8, "--imagination.recent", 16),
    *("--policy.backbone", 16, "--policy.decoder", 16, "--task.chains", 3, "--task.families", "arms", "--steps", 64),
]


def test_minutes_hold_an_iteration_at_least_and_no_report(tmp_path, monkeypatch):
    monkeypatch.setattr(learning, "report_model_error", lambda *_: time.sleep(0.5))
    out = tmp_path / "run"
    briefly = ["--minutes", 1e-9, "--unseen", "generated:val@8", "--model.hidden", 16, "--out", out]
    main(["imagine", *map(str, [*QUICK[:-2], *briefly])])
    (row,) = rows_of(out / "metrics.csv")
    finished = SavedRun(out).config["finished"]
    assert finished["steps"] == int(row["step"]) == 64
    assert finished["seconds"] < float(row["seconds"]) + 0.5


def test_a_budget_that_ends_in_the_warm_up_is_told(tmp_path, capsys):
    words = [*RECIPES["imagine"], "--imagination.warmup", 2, "--out", tmp_path / "run"]
    told = "warning: the budget ended within the 2 iterations of warm-up: the policy has not learned"
    for steps, is_told in ((128, True), (192, False)):
        main(["imagine", *map(str, [*words, "--steps", steps, *([] if is_told else ["--resume"])])])
        assert (told in capsys.readouterr().out) == is_told
    imagined = [row["imagined_cost"] for row in rows_of(tmp_path / "run" / "metrics.csv")]
    assert imagined[:2] == ["", ""]
    assert float(imagined[2]) > 0


TRAINED: dict[str, tuple[list[object], tuple[float, ...]]] = {
    "nothing": ([], (2e-3, 10.0, 1.5e-2, 20)),
    "a model": (["--init-model", "expert-model-g1"], (2e-3, 10.0, 4e-3, 8)),
    "a policy": (["--init", "imagined-g1"], (1e-3, 0.0, 1.5e-2, 20)),
    "both": (["--init", "imagined-g1", "--init-model", "expert-model-g1"], (1e-3, 0.0, 4e-3, 8)),
}


@pytest.mark.parametrize("given", [(), (5e-4, 5.0, 2e-3, 10), (2e-3, 10.0, 1.5e-2, 20)])
@pytest.mark.parametrize("trained", TRAINED)
def test_what_is_trained_already_is_changed_less(tmp_path, monkeypatch, trained, given):
    class SeenError(Exception):
        pass

    def learner(policy, actor, model, task, config, **rest):
        raise SeenError(config.rates())

    monkeypatch.setattr(learning, "ImaginationLearner", learner)
    flags, used = TRAINED[trained]
    names = ("lr", "policy-muon", "muon-lr", "warmup")
    told = [word for name, value in zip(names, given, strict=False) for word in (f"--imagination.{name}", value)]
    brief = [
        *("--motions", "generated:val@8", "--unseen", "--steps", 64),
        *("--task.chains", 3, "--task.families", "arms"),
    ]
    with pytest.raises(SeenError) as seen:
        main(["imagine", *map(str, [*brief, *flags, *told, "--out", tmp_path / "run"])])
    assert seen.value.args[0] == (given or used)


def test_a_run_from_before_muon_for_policies_goes_on_with_adam(tmp_path):
    flags, out = list(map(str, QUICK[:-2])), tmp_path / "run"
    del flags[(at := flags.index("--imagination.warmup")) : at + 2]
    before = {"policy-muon": 0, "lr": 1e-3, "muon-lr": 4e-3, "warmup": 1}
    told = [word for name, value in before.items() for word in (f"--imagination.{name}", value)]
    words = [*flags, "--model.hidden", 16, "--out", out]
    run("imagine", *words, *told, "--steps", 128)
    config = read_json(out / "config.json")
    del config["recipe"]["settings"]["imagination"]["policy_muon"], config["recipe"]["settings"]["overlap"]
    write_json(out / "config.json", config)
    used = {"lr": 1e-3, "policy_muon": 0.0, "muon_lr": 4e-3, "warmup": 1}
    for steps, given, muon in ((192, [], 0.0), (256, ["--imagination.policy-muon", 10], 10.0), (320, [], 10.0)):
        text = run("imagine", *words, *given, "--steps", steps, "--resume")
        settings = SavedRun(out).settings["imagination"]
        assert {name: settings[name] for name in used} == {**used, "policy_muon": muon}
        assert ("goes on with imagination.policy_muon 10.0 in place of 0.0" in text) == bool(given)
        assert "goes on with imagination.lr" not in text
    with pytest.raises(SystemExit, match=r"imagination.warmup is 3, was 1\. Budget"):
        run("imagine", *words, "--imagination.warmup", 3, "--steps", 384, "--resume")


@pytest.mark.parametrize("of", ["today", "an older plat"])
def test_the_student_that_is_refined_is_known_by_its_weights(tmp_path, of):
    student = write_run(tmp_path / "student", small_policy("latent"))
    words = [*REFINE, "--variant", "finetune", "--device", "cpu", "--out", out := tmp_path / "run"]
    run("refine-model", *words, "--student", student, "--steps", 64)
    inputs = read_json(out / "inputs.json")
    assert "init" not in inputs
    if of == "an older plat":
        inputs["init"] = inputs.pop("student")
        write_json(out / "inputs.json", inputs)
    student.rename(moved := tmp_path / "moved")
    text = run("refine-model", *words, "--student", moved, "--steps", 128, "--resume")
    assert f"goes on with student {moved} in place of {student}" in text
    torch.manual_seed(1)
    other = write_run(tmp_path / "other", small_policy("latent"))
    with pytest.raises(SystemExit, match="student: other content"):
        run("refine-model", *words, "--student", other, "--steps", 192, "--resume")


@pytest.mark.parametrize("recipe", ["imagine", "expert-model", "refine-model"])
def test_videos_are_of_the_policy_that_is_saved(tmp_path, monkeypatch, recipe):
    films = []

    class Seen(learning.Films):
        def __init__(self, folder, robot, play, every):
            super().__init__(folder, robot, play, every)
            films.append((play, every))

    monkeypatch.setattr(learning, "Films", Seen)
    if recipe == "refine-model":
        student = write_run(tmp_path / "student", small_policy("dagger"))
        arguments = [*REFINE, "--student", student]
    else:
        arguments = RECIPES[recipe]
    out = tmp_path / "run"
    main([recipe, *map(str, [*arguments, "--video-every", 60, "--trackio", "--steps", 64, "--out", out])])
    ((play, every),) = films
    playback, (average,) = play(), play.args
    assert every == 60
    assert len(playback.qpos) > 10
    saved = load_file(out / "model.safetensors")
    assert all(saved[name].equal(value) for name, value in average.state_dict().items())


def test_motions_too_short_for_the_report_leave_it_out(tmp_path, short_report, capsys):
    save_motions(tmp_path / "short.npz", [standing_clip("short", 20)])
    arguments = list(RECIPES["expert-model"])
    arguments.insert(arguments.index("--unseen") + 1, tmp_path / "short.npz")
    main(["expert-model", *map(str, [*arguments, "--steps", 64, "--out", tmp_path / "run"])])
    assert "model error: no episode of the unseen motions lasted 48 steps" in capsys.readouterr().out
    assert SavedRun(tmp_path / "run").config["finished"]


def test_a_window_as_long_as_what_is_kept_is_refused(tmp_path):
    arguments = [*QUICK, "--replay", 8, "--imagination.window", 8, "--out", tmp_path / "run"]
    with pytest.raises(SystemExit, match="imagination.window is 8, expected less than the 8 steps of replay"):
        main(["imagine", *map(str, arguments)])


def test_a_model_has_a_hidden_layer():
    with pytest.raises(ConfigError, match="hidden"):
        DynamicsConfig(hidden=())


@pytest.fixture
def of_a_model(tmp_path) -> list[object]:
    """Arguments that go on from a run with a small model at 0.01 s, whose settings do not say its shape."""
    folder = tmp_path / "before"
    folder.mkdir()
    write_json(folder / "config.json", {"policy": {"config": {"timing": {"control_dt": 0.01}}}})
    save_dynamics(folder, DynamicsModel(G1, DynamicsConfig(hidden=(8, 24))))
    return [*QUICK, "--init-model", folder]


def test_the_shape_of_a_model_is_handed_on(tmp_path, of_a_model):
    out = tmp_path / "run"
    arguments = ["imagine", *map(str, of_a_model), "--policy.timing.control-dt", "0.01", "--out", str(out)]
    main(arguments)
    assert SavedRun(out).settings["model"] == {"hidden": [8, 24]}
    model = load_dynamics(out, G1)
    assert (model.config.hidden, model.dt) == ((8, 24), 0.01)
    main([*arguments, "--resume"])


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ([], r"--init-model '.*before': control step of 0.01 s, expected the policy's 0.02 s"),
        (
            ["--policy.timing.control-dt", "0.01", "--model.hidden", "8", "8"],
            r"--model.hidden is \(8, 8\), expected \(8, 24\), the layers of --init-model '.*before'",
        ),
    ],
)
def test_a_model_of_another_shape_or_control_step_is_refused(tmp_path, of_a_model, flags, message):
    with pytest.raises(SystemExit, match=message):
        main(["imagine", *map(str, of_a_model), *flags, "--out", str(tmp_path / "run")])
    assert not (tmp_path / "run").exists()


def test_a_policy_that_sees_parts_learns_from_whole_keyframes(tmp_path):
    arguments = [*QUICK, "--model.hidden", 16, "--policy.also", "parts", "clock", "--out", tmp_path / "run"]
    main(["imagine", *map(str, arguments)])
    assert float(rows_of(tmp_path / "run" / "metrics.csv")[-1]["imagined_cost"]) > 0


def test_an_expert_has_no_costs_of_partial_keyframes(tmp_path):
    arguments = [*RECIPES["expert-model"], "--costs", "joint_pos=4,bodies=1", "--steps", 8, "--out", tmp_path / "x"]
    with pytest.raises(SystemExit, match=r"--costs.bodies is 1, expected 2: it is of partial keyframes"):
        main(["expert-model", *map(str, arguments)])
