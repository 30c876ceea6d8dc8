"""Every recipe as a user runs it: in a process of its own, killed in the middle, resumed, and twice with one seed."""

import csv
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from safetensors.torch import load_file

ROOT = Path(__file__).parents[2]
# enough for a few iterations of each stage; small networks and few robots
COMMON = ["--num-envs", "8", "--motions", "generated:val"]
STAGES = {
    "expert": ["--rollout", "8", "--policy.hidden", "16"],
    "distill": ["--rollout", "8", "--batch-size", "32", "--buffer-size", "500", "--updates", "2"],
    "refine": ["--rollout", "8", "--critic-warmup", "1", "--policy.hidden", "16"],
}


def command(recipe: str, *arguments: object) -> list[str]:
    return [sys.executable, "-m", "plat", recipe, *map(str, arguments)]


def run(recipe: str, *arguments: object) -> str:
    out = subprocess.run(command(recipe, *arguments), capture_output=True, text=True, check=False, cwd=ROOT)
    assert out.returncode == 0, out.stderr
    return out.stdout


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
    process = subprocess.Popen(
        command(recipe, *arguments, "--steps", 10**9), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd=ROOT
    )
    deadline = time.monotonic() + 120
    while not list(out.glob("checkpoints/checkpoint-*")) or len(steps_in(out)) < 6:
        assert process.poll() is None, process.stderr.read().decode()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    before = steps_in(out)
    text = run(recipe, *arguments, "--steps", before[-1] + 500, "--resume")
    resumed_at = int(re.search(r"resumed from .* at ([\d,]+) steps", text).group(1).replace(",", ""))
    assert 0 < resumed_at <= before[-1]
    after = steps_in(out)
    assert after == sorted(set(after))
    assert after[-1] >= before[-1] + 500
    assert after[: before.index(resumed_at) + 1] == before[: before.index(resumed_at) + 1]
    assert (out / "model.safetensors").exists()


@pytest.mark.parametrize("recipe", STAGES)
def test_one_seed_one_result(tmp_path, stages, recipe):
    rows, weights = [], []
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        run(recipe, *stages[recipe], "--out", tmp_path / name, "--steps", 300, "--seed", seed)
        with (tmp_path / name / "metrics.csv").open(newline="") as file:
            rows.append(
                [{key: value for key, value in row.items() if key != "seconds"} for row in csv.DictReader(file)]
            )
        weights.append(load_file(tmp_path / name / "model.safetensors"))
    assert rows[0] == rows[1]
    assert all(weights[0][name].equal(weights[1][name]) for name in weights[0])
    assert rows[0] != rows[2]


@pytest.mark.parametrize("recipe", [*STAGES, "evaluate", "ablations", "demo", "play", "export", "sim-to-sim"])
def test_help_explains_every_field(recipe):
    text = run(recipe, "--help")
    # tyro shows a field without a docstring as its bare type and default
    for line in re.findall(r"│\s+--[\w.-]+ .*", text):
        assert len(line) > 20
    assert "--" in text


@pytest.mark.parametrize("variant", ["latent", "action", "finetune"])
def test_variants_of_stage_three(tmp_path, stages, variant):
    run("refine", *stages["refine"], "--variant", variant, "--steps", 200, "--out", tmp_path / variant)
    assert len(steps_in(tmp_path / variant)) >= 3


def test_an_expert_goes_on_with_other_settings(tmp_path, stages):
    start = stages["distill"][-1]
    new = [*stages["expert"], "--init", start, "--task.dense.joint-pos.weight", 3, "--critic-warmup", 1000]
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
        "generated:val",
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
            "nowhere/config.json': no such",
        ),
        (
            "refine",
            ["--motions", "generated:val", "--steps", "10", "--student", "nowhere"],
            "nowhere/config.json': no such",
        ),
    ],
)
def test_bad_input_is_one_clear_line(tmp_path, recipe, arguments, message):
    out = subprocess.run(
        command(recipe, *arguments, "--out", tmp_path / "x"), capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert out.returncode == 1
    assert message in out.stderr
    assert "Traceback" not in out.stderr


def test_wandb_works_offline(tmp_path, stages):
    out = run("expert", *stages["expert"], "--steps", 50, "--out", tmp_path / "run", "--wandb", "--video-every", 0.001)
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
    out = subprocess.run(command("expert", *back), capture_output=True, text=True, check=False, cwd=ROOT)
    assert out.returncode == 1
    assert "it sees frames (1, 2, 6)" in out.stderr


def test_only_an_expert_labels(tmp_path, stages):
    student = stages["refine"][-1]
    arguments = [*COMMON, *STAGES["distill"], "--expert", student, "--steps", 100, "--out", tmp_path / "student"]
    out = subprocess.run(command("distill", *arguments), capture_output=True, text=True, check=False, cwd=ROOT)
    assert out.returncode == 1
    assert "expected a teacher, such as the expert" in out.stderr
