"""Every stage as a user runs it: killed in the middle, resumed, and twice with one seed."""

import csv
import re
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from plat.errors import ConfigError
from plat.modules import ExpertConfig, LatentPolicyConfig, RefinementConfig
from plat.objectives import PPO, ImaginationConfig, MotorGradientConfig
from plat.recipes import distill, imagine, refine, refine_model
from plat.recipes.options import (
    DistillRecipe,
    ExpertModelRecipe,
    ExpertRecipe,
    ImagineRecipe,
    RefineModelRecipe,
    RefineRecipe,
    check_distant,
)
from plat.runs import load_policy
from plat.spec.timing import Timing
from plat.tasks import AuthoredCosts, TimedKeyframesConfig
from tests.export.runs import small_policy, write_run
from tests.in_process import kill_plat, run
from tests.recipes.runs import write_motions

ROOT = Path(__file__).parents[2]
# enough for a few iterations of each stage; small networks and few robots
COMMON = ["--num-envs", "8", "--motions", "generated:val@30"]
STAGES = {
    "expert": ["--rollout", "8", "--policy.hidden", "16", "--critic", "16", "--ppo.epochs", "2"],
    "distill": ["--rollout", "8", "--batch-size", "32", "--buffer-size", "500", "--updates", "2"],
    "refine": [
        *("--rollout", "8", "--critic-warmup", "1", "--policy.hidden", "16", "--critic", "16", "--ppo.epochs", "2")
    ],
}


def command(recipe: str, *arguments: object) -> list[str]:
    return [sys.executable, "-m", "plat", recipe, *map(str, arguments)]


def error_of(recipe: str, *arguments: object) -> str:
    """Return the line that a command ends with."""
    with pytest.raises(SystemExit) as ended:
        run(recipe, *arguments)
    assert str(ended.value).count("\n") == 0
    return str(ended.value)


@pytest.fixture(scope="module")
def stages(tmp_path_factory) -> dict[str, list[object]]:
    """Arguments of each stage, on top of a tiny run of the stages before it."""
    folder = tmp_path_factory.mktemp("stages")
    run("expert", *COMMON, *STAGES["expert"], "--steps", 200, "--out", folder / "expert")
    distill = [*COMMON, *STAGES["distill"], "--expert", folder / "expert"]
    run("distill", *distill, "--steps", 200, "--out", folder / "dagger")
    return {
        "expert": [*COMMON, *STAGES["expert"]],
        "distill": distill,
        "refine": [*COMMON, *STAGES["refine"], "--student", folder / "dagger"],
    }


def rows_of(table: Path) -> list[dict[str, str]]:
    with table.open(newline="") as file:
        return list(csv.DictReader(file))


def steps_in(folder: Path) -> list[int]:
    return [int(row["step"]) for row in rows_of(folder / "metrics.csv")]


@pytest.mark.parametrize("recipe", STAGES)
def test_killed_and_resumed(tmp_path, stages, recipe):
    out = tmp_path / "run"
    arguments = [*stages[recipe], "--out", out, "--save-every", 0]

    def ready() -> bool:
        return bool(list(out.glob("checkpoints/checkpoint-*"))) and len(steps_in(out)) >= 6

    kill_plat(ready, tmp_path / "printed.txt", recipe, *arguments, "--steps", 10**9)
    before = steps_in(out)
    text = run(recipe, *arguments, "--steps", before[-1] + 200, "--resume")
    resumed_at = int(re.search(r"resumed from .* at ([\d,]+) steps", text).group(1).replace(",", ""))
    assert 0 < resumed_at <= before[-1]
    after = steps_in(out)
    assert after == sorted(set(after))
    assert after[-1] >= before[-1] + 200
    assert after[: before.index(resumed_at) + 1] == before[: before.index(resumed_at) + 1]
    assert (out / "model.safetensors").exists()


@pytest.mark.parametrize("student", ["latent", "plain"])
def test_distilling_goes_on_from_a_student_in_its_shape(tmp_path, stages, student):
    start, out = tmp_path / "start", tmp_path / "run"
    write_run(start, small_policy(student))
    arguments = [*stages["distill"], "--student", student, "--init", start]
    run("distill", *arguments, "--lr", 1e-12, "--steps", 64, "--out", out)
    before, after = load_policy(start), load_policy(out)
    assert after.config == before.config
    assert torch.allclose(after.decoder.network[0].weight, before.decoder.network[0].weight, atol=1e-6)
    assert after.normalizer.count == before.normalizer.count + 64
    run("distill", *arguments, "--lr", 1e-12, "--steps", 128, "--out", out, "--resume")
    narrow = [*arguments, "--policy.backbone", 8, "--steps", 64, "--out", tmp_path / "x"]
    assert re.search("the trained (policy|student)", error_of("distill", *narrow))
    other = "plain" if student == "latent" else "latent"
    wrong = [*arguments, "--student", other, "--steps", 64, "--out", tmp_path / "x"]
    assert f"expected a {other} student (--init, --student)" in error_of("distill", *wrong)


@pytest.mark.parametrize(
    ("expert", "stage_3"),
    [("expert-g1", "plat refine"), ("expert-model-g1", "plat refine-model --init-model expert-model-g1")],
)
def test_after_distilling_comes_stage_3_of_the_kind_that_stage_1_was(tmp_path, expert, stage_3):
    recipe = distill.DistillRecipe(motions=("generated:val",), expert=Path(expert), out=tmp_path)
    assert f"next: {stage_3} --student {tmp_path} --motions generated:val" in distill.after(recipe)


def test_what_a_policy_learned_is_not_advised_to_score_it_on(tmp_path):
    out = {"motions": ("mine.npz",), "out": tmp_path}
    student = {"student": Path("runs/dagger"), **out}
    lines = [
        imagine.after(imagine.ImagineRecipe(**out)),
        distill.after(distill.DistillRecipe(expert=Path("expert-g1"), **out | {"student": "plain"})),
        refine.after(refine.RefineRecipe(**student)),
        refine_model.after(refine_model.RefineModelRecipe(**student)),
    ]
    assert all(re.search(rf"next: plat evaluate .*{tmp_path} --motions test.npz$", text) for text in lines)


def test_a_finished_run_stays_as_it_is_and_others_are_refused(stages):
    out = Path(stages["distill"][-1])
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    arguments = [*stages["expert"], "--steps", 200, "--out", out, "--resume"]
    text = run("expert", *arguments)
    assert "the run is finished, with 256 steps; it goes on with more --steps" in text
    assert "a checkpoint every" not in text, "nothing is trained, and nothing says so"
    others = [*arguments, "--motions", "generated:test@30", "--num-envs", 4, "--policy.timing.window", 7]
    message = error_of("expert", *others)
    assert "num_envs is 4, was 8; policy.timing.window is 7, was " in message
    assert "motions: clip 0 is '" in message
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("recipe", STAGES)
def test_one_seed_one_result(tmp_path, stages, recipe):
    rows, weights = [], []
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        run(recipe, *stages[recipe], "--out", tmp_path / name, "--steps", 250, "--seed", seed)
        with (tmp_path / name / "metrics.csv").open(newline="") as file:
            rows.append(
                [{key: value for key, value in row.items() if key != "seconds"} for row in csv.DictReader(file)]
            )
        weights.append(load_file(tmp_path / name / "model.safetensors"))
    assert rows[0] == rows[1]
    assert all(weights[0][name].equal(weights[1][name]) for name in weights[0])
    assert rows[0] != rows[2]


@pytest.mark.parametrize("variant", ["latent", "action", "finetune"])
def test_variants_of_stage_three(tmp_path, stages, variant):
    run("refine", *stages["refine"], "--variant", variant, "--steps", 200, "--out", tmp_path / variant)
    assert len(steps_in(tmp_path / variant)) >= 3


@pytest.mark.parametrize("stage", ["expert", "refine"])
def test_the_critic_learns_alone_for_as_many_rollouts_as_are_set(tmp_path, stages, monkeypatch, stage):
    learned = []
    step = PPO.step

    def watched(self, rollout, learn_policy=True, gradient=None):
        learned.append(learn_policy)
        return step(self, rollout, learn_policy, gradient)

    monkeypatch.setattr(PPO, "step", watched)
    start = ["--init", stages["distill"][-1]] if stage == "expert" else []
    flags = [*stages[stage], *start, "--critic-warmup", 2, "--steps", 5 * 8 * 8, "--out", tmp_path / "run"]
    run(stage, *flags)
    assert learned == [False, False, True, True]  # of five rollouts, the first fills the normalizers


def test_an_expert_goes_on_with_other_settings(tmp_path, stages):
    start = stages["distill"][-1]
    new = [*stages["expert"], "--init", start, "--task.dense.joint-pos", 3, 0.15, "--critic-warmup", 1000]
    text = run("expert", *new, "--policy.lead", 0.03, "--steps", 200, "--out", tmp_path / "run")
    assert "goes on with lead 0.03 in place of 0.065\n" in text
    before, after = (load_file(folder / "model.safetensors") for folder in (start, tmp_path / "run"))
    networks = [name for name in before if "network" in name]
    assert networks
    assert all(before[name].equal(after[name]) for name in networks)  # only the critic has learned so far
    assert after["normalizer.count"] > before["normalizer.count"]
    assert {row["lr"] for row in rows_of(tmp_path / "run" / "metrics.csv") if row["lr"]} == {"3e-05"}


def test_evaluation_prints_and_writes_the_table(tmp_path, stages):
    plain = [*stages["distill"], "--student", "plain"]
    run("distill", *plain, "--steps", 100, "--out", tmp_path / "plain")
    text = run(
        "evaluate",
        tmp_path / "plain",
        "--motions",
        write_motions(tmp_path),
        "--horizon",
        "long",
        "--csv",
        tmp_path / "table.csv",
    )
    assert re.search(r"plain\s+long\s+[\d.]+ \([\d.]+-[\d.]+\)", text)
    rows = {row["metric"]: row for row in rows_of(tmp_path / "table.csv")}
    assert {"tks", "mpjpe", "mpkpe", "mpkpe_all", "success_area"} <= set(rows)
    assert float(rows["tks"]["low"]) <= float(rows["tks"]["value"]) <= float(rows["tks"]["high"])


@pytest.mark.parametrize(
    ("recipe", "arguments", "message"),
    [
        ("expert", ["--motions", "nowhere.npz", "--steps", "10"], "motion file 'nowhere.npz': no such"),
        ("expert", ["--motions", "generated:val"], "expected a positive number"),
        (
            "expert",
            ["--motions", "generated:val", "--steps", "10", "--init", str(ROOT / "plat" / "weights" / "dagger")],
            "holds a policy of kind 'latent', expected an expert",
        ),
        (
            "distill",
            ["--motions", "generated:val", "--steps", "10", "--expert", "nowhere"],
            "'nowhere': no such run",
        ),
        (
            "refine",
            ["--motions", "generated:val", "--steps", "10", "--student", "nowhere"],
            "'nowhere': no such run",
        ),
    ],
)
def test_bad_input_is_one_clear_line(tmp_path, recipe, arguments, message):
    assert message in error_of(recipe, *arguments, "--out", tmp_path / "x")


def test_wandb_works_offline(tmp_path):
    motions = write_motions(tmp_path, 31)  # short, as its video is
    short = ["--num-envs", 8, "--motions", motions, *STAGES["expert"], "--steps", 50]
    out = run("expert", *short, "--out", tmp_path / "run", "--wandb", "--video-every", 0.001)
    assert list((tmp_path / "run" / "wandb").glob("offline-run-*"))
    # a machine without OpenGL says so and goes on
    assert list((tmp_path / "run" / "videos").glob("*.mp4")) or "no videos" in out


def test_an_expert_goes_on_with_more_frames_and_labels(tmp_path, stages):
    far_sighted, before = tmp_path / "far-sighted", stages["distill"][-1]
    frames = ["--policy.ahead", 1, 2, 6]
    run("expert", *stages["expert"], *frames, "--init", before, "--steps", 100, "--out", far_sighted)
    run("distill", *COMMON, *STAGES["distill"], "--expert", far_sighted, "--steps", 100, "--out", tmp_path / "student")
    assert len(steps_in(tmp_path / "student")) >= 1
    back = [*stages["expert"], "--init", far_sighted, "--steps", 100, "--out", tmp_path / "back"]
    assert "it sees frames (1, 2, 6)" in error_of("expert", *back)


def test_only_an_expert_labels(tmp_path, stages):
    student = stages["refine"][-1]
    arguments = [*COMMON, *STAGES["distill"], "--expert", student, "--steps", 100, "--out", tmp_path / "student"]
    assert "expected a teacher, such as the expert" in error_of("distill", *arguments)


def test_a_process_ends_with_one_line_and_no_traceback(tmp_path):
    arguments = ["--motions", "nowhere.npz", "--steps", 10, "--out", tmp_path / "x"]
    out = subprocess.run(command("expert", *arguments), capture_output=True, text=True, check=False, cwd=ROOT)
    assert out.returncode == 1
    assert "error: motion file 'nowhere.npz': no such" in out.stderr
    assert "Traceback" not in out.stderr


def test_distillation_prints_no_warning_of_torch(tmp_path, stages):
    torch.set_warn_always(True)  # else only the first run of a process would warn
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            run("distill", *stages["distill"], "--steps", 50, "--out", tmp_path / "dagger")
    finally:
        torch.set_warn_always(False)
    assert not [str(warning.message) for warning in caught if "requires_grad" in str(warning.message)]


NO_LATENT = "and a plain student has no latent: set --student latent"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"policy": LatentPolicyConfig(latent_size=8)}, f"policy.latent_size is 8, {NO_LATENT}"),
        ({"policy": LatentPolicyConfig(min_std=0.5)}, f"policy.min_std is 0.5, {NO_LATENT}"),
        ({"beta": 3.0}, "beta is 3.0, without --posterior there is no divergence"),
        ({"beta": 3.0, "student": "latent"}, "beta is 3.0, without --posterior there is no divergence"),
        ({"task": TimedKeyframesConfig(stride=4)}, "task.stride is 4, without --posterior nothing sees these frames"),
        ({"posterior": 0.5}, "posterior is 0.5, and a plain student has none"),
    ],
)
def test_what_only_a_latent_has_is_refused_without(tmp_path, settings, message):
    usual = {"motions": ("a.npz",), "out": tmp_path, "minutes": 1.0}
    with pytest.raises(ConfigError, match=f"ImagineRecipe: {message}"):
        ImagineRecipe(**usual, **settings)
    ImagineRecipe(**usual, **{**settings, "student": "latent", "posterior": 0.5})
    ImagineRecipe(**usual, policy=LatentPolicyConfig(backbone=(8,), symmetric=True))
    if "posterior" not in settings:
        ImagineRecipe(**usual, **settings, resume=True)  # begun when they were ignored


@pytest.mark.parametrize(
    ("name", "value"),
    [("stride", 1), ("prior_weight", 0.5), ("beta", 0.5), ("beta_warmup", 0.5), ("free_bits", 0.5)],
)
def test_distillation_refuses_what_a_plain_student_ignores(tmp_path, name, value):
    usual = {"motions": ("a.npz",), "out": tmp_path, "minutes": 1.0, "expert": Path("expert"), name: value}
    with pytest.raises(ConfigError, match=f"DistillRecipe: {name} is {value}, {NO_LATENT}"):
        DistillRecipe(**usual, student="plain")
    DistillRecipe(**usual)
    DistillRecipe(**usual, student="plain", resume=True)


def test_distillation_refuses_the_shape_of_a_latent_for_a_plain_student(tmp_path):
    usual = {"motions": ("a.npz",), "out": tmp_path, "minutes": 1.0, "expert": Path("expert"), "student": "plain"}
    with pytest.raises(ConfigError, match=rf"policy.prior is \(8,\), {NO_LATENT}"):
        DistillRecipe(**usual, policy=LatentPolicyConfig(prior=(8,)))
    DistillRecipe(**usual, policy=LatentPolicyConfig(decoder=(8,)))


DENSE = ExpertConfig(action="reference_velocity", ahead=(1, 2))
NEEDS = {
    "DistillRecipe": {"expert": Path("x")},
    "RefineRecipe": {"student": Path("x")},
    "RefineModelRecipe": {"student": Path("x")},
}


@pytest.mark.parametrize(
    ("recipe", "settings", "message"),
    [
        (ExpertRecipe, {"init_lr": 1e-4}, "init_lr is 0.0001, and without --init nothing"),
        (ExpertRecipe, {"critic_warmup": 3}, "critic_warmup is 3, and without --init nothing"),
        (ExpertRecipe, {"motor": MotorGradientConfig(weight=0, legs=0.1)}, "motor.legs is 0.1, and motor.weight is 0"),
        (ExpertRecipe, {"policy": replace(DENSE, catch_up_limit=1.0)}, "policy.catch_up_limit is 1.0, without"),
        (
            ExpertModelRecipe,
            {"policy": ExpertConfig(action="default_offset", residual_limit=1.0)},
            "policy.residual_limit is 1.0, and policy.action 'default_offset'",
        ),
        (ExpertModelRecipe, {"video_every": 60.0}, "video_every is 60, and nothing logs videos"),
        (DistillRecipe, {"beta": 0.0, "free_bits": 0.5}, "free_bits is 0.5, and beta is 0"),
        (DistillRecipe, {"beta": 0.0, "beta_warmup": 0.5}, "beta_warmup is 0.5, and beta is 0"),
        (DistillRecipe, {"expert_share": 0.0, "expert_until": 0.5}, "expert_until is 0.5, and expert_share is 0"),
        (
            RefineRecipe,
            {"variant": "latent-noise", "motor": MotorGradientConfig(legs=0.1)},
            "motor.legs is 0.1, and the gradient is of actions",
        ),
        (RefineRecipe, {"policy": RefinementConfig(shortest_lead=0.2)}, "policy.shortest_lead is 0.2, without"),
        (RefineModelRecipe, {"policy": RefinementConfig(init_std=0.1)}, "policy.init_std is 0.1, and robots of imag"),
        (RefineModelRecipe, {"policy": RefinementConfig(min_std=0.1)}, "policy.min_std is 0.1, and robots of imag"),
        (RefineModelRecipe, {"task": TimedKeyframesConfig(stride=4)}, "task.stride is 4, and no posterior"),
        (ImagineRecipe, {"imagination": ImaginationConfig(lost_cost=1)}, "imagination.lost_cost is 1, without"),
        (ImagineRecipe, {"imagination": ImaginationConfig(constant=1, final_lr=0.5)}, "imagination.final_lr is 0.5"),
        (ImagineRecipe, {"imagination": ImaginationConfig(final_lr=1, constant=0.2)}, "imagination.constant is 0.2"),
    ],
)
def test_settings_without_effect_are_refused(tmp_path, recipe, settings, message):
    usual = {"motions": ("a.npz",), "out": tmp_path, "minutes": 1.0, **NEEDS.get(recipe.__name__, {})}
    recipe(**usual)
    with pytest.raises(ConfigError, match=re.escape(f"{recipe.__name__}: {message}")) as refused:
        recipe(**usual, **settings)
    assert "\n" not in str(refused.value)
    recipe(**usual, **settings, resume=True)  # begun when they were ignored


OLDEST = {"lr": 1e-3, "muon_lr": 4e-3, "warmup": 40}
DAY = {"lr": 2e-3, "policy_muon": 10.0, "muon_lr": 1.5e-2, "warmup": 20}


@pytest.mark.parametrize(
    ("trained", "saved", "used"),
    [
        ([], {"imagination": OLDEST}, (1e-3, 0.0, 4e-3, 40)),
        (["init_model", "init"], {"imagination": OLDEST}, (1e-3, 0.0, 4e-3, 8)),
        (["init_model"], {"imagination": {**OLDEST, "warmup": 5}}, (1e-3, 0.0, 4e-3, 5)),
        (["init"], {"imagination": {**OLDEST, "lr": 2e-3}}, (2e-3, 0.0, 4e-3, 40)),
        ([], {"imagination": DAY, "processes": 1}, (2e-3, 10.0, 1.5e-2, 20)),
        (["init_model", "init"], {"imagination": DAY, "processes": 1}, (1e-3, 0.0, 4e-3, 8)),
        (["init"], {"imagination": {**DAY, "lr": 5e-4}, "processes": 1}, (5e-4, 0.0, 1.5e-2, 20)),
        (["init_model", "init"], {"imagination": DAY, "overlap": False}, (2e-3, 10.0, 1.5e-2, 20)),
    ],
)
def test_a_resumed_run_keeps_the_rates_that_it_learned_with(tmp_path, trained, saved, used):
    """Runs from before Muon for policies, of the day on which defaults stood for what suits, and of today."""
    usual = {"motions": ("a.npz",), "out": tmp_path, "minutes": 1.0, **dict.fromkeys(trained, tmp_path)}
    recipe = ImagineRecipe(**usual, resume=True)
    assert recipe.with_rates(saved).rates() == used
    assert ImaginationConfig(**recipe.as_written_now(saved)["imagination"]).rates() == used
    told = ImagineRecipe(**usual, resume=True, imagination=ImaginationConfig(lr=1e-5, policy_muon=3.0))
    assert told.with_rates(saved).rates() == (1e-5, 3.0, *used[2:])


def test_a_share_of_long_commands_needs_a_timing_that_allows_them(tmp_path):
    usual = {"motions": ("a.npz",), "out": tmp_path, "minutes": 1.0, "task": TimedKeyframesConfig(distant=0.5)}
    check_distant(ImagineRecipe(**usual), Timing(max_steps=51))
    with pytest.raises(ConfigError, match="task.distant is 0.5, and commands take 1 s at most"):
        check_distant(ImagineRecipe(**usual), Timing())


def test_settings_that_serve_a_part_or_another_variant_are_taken(tmp_path):
    usual = {"motions": ("a.npz",), "out": tmp_path, "minutes": 1.0}
    # flags that the rows of a comparison share
    RefineRecipe(**usual, student=tmp_path, variant="finetune", policy=RefinementConfig(hidden=(8,), alpha=1.0))
    ImagineRecipe(**usual, task=TimedKeyframesConfig(authored=0, underway=AuthoredCosts(lean=1)))
    ImagineRecipe(**usual, student="latent", policy=LatentPolicyConfig(posterior=(8,)))
    ExpertRecipe(**usual, init=tmp_path, init_lr=1e-4, critic_warmup=3, video_every=0.0)
    DistillRecipe(**usual, expert=tmp_path, expert_share=0.5, expert_until=0.5, beta=0.1, beta_warmup=0.5)
    ExpertRecipe(**usual, video_every=60.0, wandb=True)
    RefineRecipe(**usual, student=tmp_path, variant="latent-noise", motor=MotorGradientConfig(weight=0), rollout=4)
    ImagineRecipe(**usual, student="latent", init=tmp_path, policy=LatentPolicyConfig(posterior=(8,)))
