"""Runs that are killed at random moments and resumed: do they end as one that was not?

python -m tests.campaigns.kills --kills 100

Every try trains a tiny run of a recipe in a process of its own, kills it (SIGKILL) at a random moment, resumes it, and
so on, with one to three kills a try. Then weights and metrics are compared bit by bit with those of a run that nobody
killed. Metrics are compared without wall time. It needs ``os.fork``: imports are paid once.
"""

import argparse
import csv
import os
import random
import resource
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import torch

import plat.headless  # noqa: F401
from plat.cli import COMMANDS
from plat.cli.settings import parse
from plat.recipes import distill, expert, expert_model, imagine, refine, refine_model
from plat.runs import is_run, report_errors
from plat.scratch import Scratch

MAINS = {
    "expert": expert.main,
    "expert-model": expert_model.main,
    "imagine": imagine.main,
    "distill": distill.main,
    "refine": refine.main,
    "refine-model": refine_model.main,
}
COMMON = ["--motions", "generated:val@8", "--num-envs", "4", "--rollout", "4", "--device", "cpu"]
VARIED = ["--task.randomization", "control_delay=0.5", "--task.noise", "joint_pos=0.02"]
HIDDEN = ["--policy.hidden", "16"]
NETWORKS = ["--policy.backbone", "16", "--policy.hidden-size", "16", "--policy.decoder", "16"]
IMAGINED = [
    *("--replay", "24", "--model.hidden", "16", "--imagination.warmup", "1", "--imagination.settle", "2"),
    *("--imagination.model-batch", "8", "--imagination.policy-batch", "8", "--imagination.steps", "4"),
    *("--imagination.window", "2", "--imagination.model-updates", "1", "--imagination.policy-updates", "1"),
    "--unseen",
]
LATENT = ["--batch-size", "16", "--buffer-size", "100", "--updates", "1"]
EXPERT = ["expert", "--policy.hidden", "16", "--critic", "16", "--motor.steps", "2"]
TASKS: dict[str, list[str]] = {
    "expert": [*EXPERT, *VARIED],
    "expert-init": [*EXPERT, "--critic-warmup", "3", "--init", "{expert}"],
    "expert-model": ["expert-model", "--policy.hidden", "16", *IMAGINED],
    "imagine": ["imagine", "--task.chains", "6", *NETWORKS, *IMAGINED],
    "disturbed": ["imagine", "--disturbed", "1", "--task.chains", "6", *NETWORKS, *IMAGINED],
    "latent": ["imagine", "--student", "latent", "--posterior", "0.5", "--task.chains", "6", *NETWORKS, *IMAGINED],
    "critic": ["imagine", "--imagination.critic", "16", "--task.chains", "6", *NETWORKS, *IMAGINED],
    "distill": ["distill", "--expert", "{expert}", *NETWORKS, *LATENT],
    "distill-plain": ["distill", "--expert", "{expert}", "--student", "plain", *NETWORKS, *LATENT],
    "refine": ["refine", "--student", "{distill}", "--critic", "16", "--critic-warmup", "3", "--policy.hidden", "16"],
    "refine-model": ["refine-model", "--student", "{distill}", "--task.chains", "6", *HIDDEN, *IMAGINED],
}
"""Arguments of each task; ``{expert}`` is the unbroken run of that name."""
WALL_TIME = ("seconds",)


def settings(task: str, folder: Path, out: Path, steps: int, save_every: float, resume: bool) -> object:
    """Settings of a try."""
    name, *own = (word.format(**{run: folder / run for run in TASKS}) for word in TASKS[task])
    words = [*COMMON, *own, "--out", str(out), "--steps", str(steps), "--save-every", str(save_every)]
    return parse(COMMANDS[name].kind(), [*words, "--resume"] if resume else words)


def begin(task: str, folder: Path, out: Path, steps: int, save_every: float) -> int:
    """Start or resume a run in a process of its own; its number. What it prints goes to a file beside the run."""
    recipe = settings(task, folder, out, steps, save_every, resume=is_run(out))
    sys.stdout.flush()
    process = os.fork()
    if process:
        return process
    status = 1
    with suppress(BaseException), out.with_suffix(".log").open("a") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        with report_errors():
            MAINS[TASKS[task][0]](recipe)
        status = 0
        sys.stdout.flush()
    os._exit(status)


def ended(process: int, seconds: float) -> int | None:
    """Exit code of a process that ends within some seconds of work; None for one that goes on."""
    began = time.monotonic()
    while True:
        found, status = os.waitpid(process, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        if worked(process, began) >= seconds:
            return None
        time.sleep(0.002)


def worked(process: int, began: float) -> float:
    """Seconds of the processor that a process has had, so that other programs do not shift the kills; else by clock."""
    stat = Path(f"/proc/{process}/stat")
    if not stat.exists():
        return time.monotonic() - began
    fields = stat.read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def rows(out: Path) -> list[dict[str, str]]:
    """Metrics of a run without wall time."""
    with (out / "metrics.csv").open(newline="") as file:
        return [{key: value for key, value in row.items() if key not in WALL_TIME} for row in csv.DictReader(file)]


def differences(ours: Path, theirs: Path) -> Iterator[str]:
    """Yield what two runs differ in."""
    if rows(ours) != rows(theirs):
        pairs = zip(rows(ours), rows(theirs), strict=False)
        first = next((index for index, (a, b) in enumerate(pairs) if a != b), "their number")
        yield f"metrics, from row {first}"
    for path in sorted(theirs.glob("*.safetensors")):
        if (ours / path.name).read_bytes() != path.read_bytes():
            yield path.name


def unbroken(task: str, folder: Path, steps: int) -> float:
    """Train a run without a kill; the seconds of work that it takes."""
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    if ended(begin(task, folder, folder / task, steps, 0.0), 600) != 0:
        raise SystemExit(f"{task}: failed\n{(folder / task).with_suffix('.log').read_text()}")
    if not Path("/proc/self/stat").exists():
        return time.monotonic() - started
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def broken(task: str, folder: Path, steps: int, seconds: float, chance: random.Random) -> tuple[int, list[str]]:
    """Train a run with kills; how many hit it, and what differs from the unbroken one."""
    out = folder / "broken"
    shutil.rmtree(out, ignore_errors=True)
    out.with_suffix(".log").unlink(missing_ok=True)
    # with every iteration in a checkpoint, half of the kills hit the writing of one
    save_every, kills = chance.choice([0.0, 0.0, 0.2 * seconds]), 0
    for _ in range(chance.randint(1, 3)):
        process = begin(task, folder, out, steps, save_every)
        if ended(process, chance.uniform(0.0, seconds)) is not None:
            break
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
        kills += 1
    code = ended(begin(task, folder, out, steps, save_every), 600)
    found = [f"exit code {code}: {out.with_suffix('.log').read_text()[-300:]!r}"] if code else []
    return kills, found or list(differences(out, folder / task))


def needed(tasks: list[str]) -> list[str]:
    """Tasks and those whose runs they start from, in an order in which they can be trained."""
    names = set(tasks)
    for task in reversed(TASKS):
        names |= {run for run in TASKS if task in names and f"{{{run}}}" in TASKS[task]}
    return [task for task in TASKS if task in names]


@contextmanager
def workplace() -> Iterator[Path]:
    """A folder for the runs, with one thread and one cache of motions."""
    torch.set_num_threads(1)
    with Scratch("plat-kills-") as folder:
        os.environ.setdefault("PLAT_CACHE_DIR", str(folder / "cache"))
        yield folder


def campaign(kills: int, seed: int, iterations: int, tasks: list[str]) -> int:
    """Run the campaign and print its figures; how many tries were not identical."""
    chance = random.Random(seed)
    tried, same, hit = dict.fromkeys(tasks, 0), dict.fromkeys(tasks, 0), dict.fromkeys(tasks, 0)
    steps = 4 * 4 * iterations
    with workplace() as folder:
        seconds = {}
        for task in needed(tasks):
            seconds[task] = unbroken(task, folder, steps)
            print(f"{task:<14} unbroken in {seconds[task]:.1f} s, {len(rows(folder / task))} rows", flush=True)
        while sum(hit.values()) < kills:
            task = min(tasks, key=lambda name: hit[name])
            count, found = broken(task, folder, steps, seconds[task], chance)
            tried[task], hit[task], same[task] = tried[task] + 1, hit[task] + count, same[task] + (not found)
            if sum(tried.values()) % 10 == 0:
                print(f"{sum(hit.values())} kills in {sum(tried.values())} runs", flush=True)
            if found:
                print(f"{task}: try {tried[task]} with {count} kills differs: {'; '.join(found)}", flush=True)
    for task in tasks:
        print(f"{task:<14} {hit[task]:4d} kills in {tried[task]:4d} runs, {same[task]:4d} identical")
    failed = sum(tried.values()) - sum(same.values())
    print(f"{'all':<14} {sum(hit.values()):4d} kills in {sum(tried.values()):4d} runs, {failed} not identical")
    return failed


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--iterations", type=int, default=16)
    parser.add_argument("--tasks", nargs="*", default=list(TASKS), choices=list(TASKS))
    chosen = parser.parse_args()
    sys.exit(min(1, campaign(chosen.kills, chosen.seed, chosen.iterations, chosen.tasks)))
