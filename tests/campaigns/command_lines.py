"""Misused command lines: each ends in one line that says what would be right, or is right.

python -m tests.campaigns.command_lines            # all, in minutes
python -m tests.campaigns.command_lines --quick    # those that are refused before any work
python -m tests.campaigns.command_lines --only expert

Each runs in an empty folder, most of them in this process. One holds if it is refused with one line that begins with
``error:``, or is right and comes to its end, within half a minute of work. What was refused leaves nothing behind.
"""

import argparse
import contextlib
import io
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

SECONDS = 30
"""Of work of the processor."""
WAITING = 300
"""Seconds after which a case hangs that does not work; long, for the processor may be busy with other programs."""

_TRAIN = "--motions {clips} --steps 64 --num-envs 2 --rollout 8 --device cpu"
_TINY = {
    "expert": f"expert {_TRAIN} --out new --policy.hidden 8 8 --critic 8 --ppo.minibatches 2",
    "distill": f"distill {_TRAIN} --out new --expert {{expert}} --policy.backbone 8 --batch-size 8 --buffer-size 64 "
    "--policy.hidden-size 8 --policy.decoder 8 --policy.prior 8 --policy.posterior 8 --updates 1",
    "refine": f"refine {_TRAIN} --out new --student {{latent}} --policy.hidden 8 --critic 8 --ppo.minibatches 2",
    "imagine": f"imagine {_TRAIN} --out new --policy.backbone 8 --policy.hidden-size 8 --policy.decoder 8 "
    "--model.hidden 8 --task.chains 4 --unseen {clips} --imagination.model-batch 4 --imagination.policy-batch 4",
    "refine-model": f"refine-model {_TRAIN} --out new --student {{latent}} --policy.hidden 8 --model.hidden 8 "
    "--task.chains 4 --unseen {clips} --imagination.model-batch 4 --imagination.policy-batch 4",
    "expert-model": f"expert-model {_TRAIN} --out new --policy.hidden 8 --model.hidden 8 --unseen {{clips}} "
    "--imagination.model-batch 4 --imagination.policy-batch 4",
}

# a command line, and what is added to it, one a line; "ok" begins those that are right
QUICK: tuple[tuple[str, str], ...] = (
    (
        "{nothing}",
        """
        expret
        --helpp
        -x
        Expert
        evaluate.
        """,
    ),
    (
        _TINY["expert"],
        """
        --num-envs 0
        --num-envs -3
        --num-envs 2.5
        --num-envs 1000000000
        --num-envs two
        --steps 0
        --steps -1
        --steps 1e6
        --minutes nan
        --minutes inf
        --minutes -inf
        --minutes -1
        --minutes 0
        --seed -1
        --seed 1180591620717411303424
        --seed 0.5
        --rollout 0
        --rollout -4
        --policy.ahead 1
        --policy.ahead
        --policy.ahead 0 1
        --policy.ahead -1 2
        --policy.hidden 0
        --policy.hidden -8 8
        --policy.hidden 8 8 99999999
        --policy.init-std 0
        --policy.init-std -1
        --policy.min-std nan
        --policy.lead -0.1
        --policy.lead nan
        --policy.action walk
        --policy.normalizer clip=0
        --policy.normalizer eps=nan
        --policy.timing.control-dt 0
        --policy.timing.control-dt nan
        --policy.timing.max-steps 0
        --policy.timing.window 0
        --policy.residual-limit 0
        --critic 0
        --critic-warmup -1
        --init-lr 0
        --ppo.gamma 2
        --ppo.gamma -0.1
        --ppo.lmbda nan
        --ppo.clip 0
        --ppo.epochs 0
        --ppo.minibatches 0
        --ppo.lr 0
        --ppo.lr nan
        --ppo.min-lr 1
        --ppo.grad-norm 0
        --ppo.target-kl -1
        --ppo.entropy -1
        --ppo.truncated never
        --ppo.precision float8
        --motor.weight -1
        --motor.steps 0
        --task.decimation 0
        --task.feet boots
        --task.uniform-starts 1.5
        --task.max-displacement 0
        --task.reset-noise yaw=-1
        --task.reset-noise yaw=nan
        --task.reset-noise yaw
        --task.noise joint_pos=inf
        --task.randomization push_interval=3:1
        --task.randomization push_interval=0:1
        --task.randomization motor_gain=2
        --task.dense.joint-pos 1 0
        --task.dense.joint-pos -1 1
        --task.dense.joint-pos 1
        --task.regularization torque=1
        --task.regularization soft_limit=2
        --task.limits anchor_height=0
        --save-every -1
        --save-every nan
        --video-every nan
        --preset worst
        --preset
        --motions
        --out
        --num-env 3
        --colour red
        extra words
        """,
    ),
    (
        _TINY["distill"],
        """
        --student wide
        --horizon never
        --updates 0
        --batch-size 0
        --buffer-size 0
        --stride 0
        --prior-weight -1
        --beta nan
        --beta-warmup 0
        --expert-until 0
        --expert-share 2
        --lr 0
        --grad-norm 0
        --free-bits -1
        --policy.latent-size 0
        --policy.min-std 0
        --policy.encoder-size 0
        """,
    ),
    (
        _TINY["refine"],
        """
        --variant sideways
        --policy.alpha -1
        --policy.shortest-lead 0
        --policy.init-std 0
        --task.dense-weight -1
        --task.sparse.joint-pos 1 -1
        """,
    ),
    (
        _TINY["imagine"],
        """
        --noise -1
        --replay 0
        --task.authored 2
        --task.families
        --task.chains 0
        --task.shortest 0
        --task.tracking root_pos=-1
        --task.underway height=nan
        --imagination.window 0
        --imagination.discount 1.5
        --imagination.average nan
        --imagination.model-updates 0
        --model.hidden 0
        --student wide
        --posterior 0.5
        --posterior 2
        --beta -1
        --task.partial 2
        --task.authored nan
        --disturbed nan
        """,
    ),
    (
        _TINY["expert-model"],
        """
        --uniform-starts 1.5
        --imagination.average 1
        --imagination.average -0.5
        --imagination.steps 0
        --imagination.recent 0
        --imagination.lost-cost -1
        --imagination.grad-norm 0
        --imagination.muon-lr nan
        --imagination.model-lr 0
        --imagination.warmup -1
        --imagination.settle 0.5
        --imagination.constant 2
        --imagination.final-lr -1
        --imagination.policy-updates 0
        --imagination.critic 0
        --imagination.window 1000000
        --disturbed -1
        --replay -5
        --noise nan
        --model.hidden -8
        --workers -1
        --workers 99
        --physics warp --workers 1
        --physics bullet
        --policy.action default
        """,
    ),
    (
        _TINY["refine-model"],
        """
        --variant sideways
        --imagination.policy-batch 0
        --task.families
        --policy.alpha nan
        --student
        --steps 0
        """,
    ),
    ("ablations --runs {tmp} --out new --motions {clips}", "--horizon\n--motions\n--num-envs 0\n--hard ["),
    (
        "benchmark {latent} --out new --device cpu",
        """
        --clips -1
        --generated 0
        --generated nan
        --longest 0
        --longest nan
        --strengths 0
        --robustness-clips 0
        --robustness wind
        --interface telepathy
        --rule none
        --authored -1
        --ours nobody
        --seed -1
        --num-envs 0
        --workers -1
        --horizons
        --further-horizons
        --interface
        """,
    ),
    (
        "evaluate {expert} --motions {clips} --num-envs 4 --horizon single --device cpu",
        """
        --horizon never
        --horizon
        --interface
        --motions
        --num-envs 0
        --seed -1
        --authored -1
        --authored 1 --pushes nan
        --disturbed -1
        --disturbed inf
        --whole-clips nobody
        --robustness wind
        --interface telepathy
        --workers -1
        --partial 2
        --randomization push_interval=5:1
        """,
    ),
    (
        "play --policy {latent} --keyframes {keyframes}",
        """
        --hold -1
        --hold nan
        --push nan
        --push -1
        --push-every 0
        --seed -1
        """,
    ),
    ("studio", "--port 0\n--port 99999\n--port http"),
    (
        "motions inspect {clips}",
        """
        --pictures -1
        --limits.tempo 0.5
        --limits.joint-excess 2
        --limits.slip nan
        --fps 0
        --fps nan
        --quat-order zyxw
        """,
    ),
    (
        "motions convert {clips} --out new.npz",
        """
        --trim -1 0
        --trim 1
        --trim nan 0
        --format bvh
        --ground mud
        --resample 0
        --resample nan
        --resample 100000
        """,
    ),
    (
        "motions retarget a.bvh --out new",
        "--workers 0\n--workers -1\n--solver.iterations 0\n--solver.max-joint-speed 0\n--fps -30",
    ),
    ("keyframes from-motion {clips} --clip run_a --out new.json", "--every 0\n--every nan\n--times -1\n--begin -1"),
    ("curves {expert}", "--smooth 0"),
    ("sim-to-sim bundle", "--seed -1"),
    ("demo", "--expert-minutes 0\n--refine-minutes nan\n--num-envs 0\n--seed 1e9"),
    (
        "ablations --runs {tmp} --out new --motions {clips}",
        "--training.seeds\n--training.seeds -1\n--training.refine-steps 0\n--training.num-envs 0",
    ),
)
FULL: tuple[tuple[str, str], ...] = (
    (
        _TINY["expert"],
        """
        ok
        ok --seed 4294967295
        ok --policy.hidden
        --ppo.minibatches 1000
        --device cuda
        --device cuda:7
        --device gpu
        --device meta
        --device mps
        --robot r2d2
        --robot nothing.json
        --robot {clips}
        --robot {tmp}
        --motions nothing.npz
        --motions {tmp}/none*.npz
        --motions {empty}
        --motions {text}
        --motions {folder}
        --motions generated:val@nan
        --motions generated:val@inf
        --motions generated:val@-5
        --motions generated:val@0
        --motions generated:val@1e12
        --motions generated:never
        --motions generated:val/juggling
        --motions generated:
        --out {text}
        --out {text}/below
        --out /proc/none
        --out {fifo}
        --out {expert}
        --resume --out {folder}
        --init nothing
        --init {latent}
        --init {text}
        --init {folder}
        ok --policy.ahead 1 100000
        --motor.steps 100
        --policy.timing.control-dt 1e-9
        --policy.timing.control-dt 1e9
        """,
    ),
    (
        _TINY["distill"],
        """
        ok
        ok --student plain
        --expert nothing
        --expert {latent}
        --expert {text}
        --expert {folder}
        --buffer-size 1
        ok --stride 100000
        --horizon distant
        --policy.timing.control-dt 0.05
        --policy.timing.max-steps 100000
        --out {expert}
        """,
    ),
    (
        _TINY["refine"],
        """
        ok
        ok --variant action
        --student nothing
        --student {expert}
        --student {text}
        --import no_such_module
        --import os.path.none
        --horizon distant
        --ppo.minibatches 1000
        """,
    ),
    (
        _TINY["imagine"],
        """
        --init nothing
        --init {expert}
        --init-model {latent}
        --task.families juggling
        --task.shortest 1000
        --unseen nothing.npz
        ok --replay 1
        --imagination.window 1000
        --imagination.steps 100000
        """,
    ),
    (
        _TINY["refine-model"],
        "--student {expert}\n--variant latent-noise\n--init-model nothing\n--task.partial 0.5\n--horizon mixed",
    ),
    (_TINY["expert-model"], "--init {latent}\n--init-model nothing\n--unseen generated:val@nan"),
    (
        "evaluate {expert} --motions {clips} --num-envs 4 --horizon single --device cpu",
        """
        ok
        ok --csv new.csv
        --csv {folder}
        --csv {text}/below.csv
        --csv /proc/none/a.csv
        --csv {fifo}
        --figures {text}
        --figures /proc/none
        --only nothing_of_this_name
        --only *
        --clip [
        --clip nothing_of_this_name
        --motions nothing.npz
        --motions generated:val@nan
        --horizon distant
        --device cuda
        --robot r2d2
        --trackers.twist2 nothing.onnx
        --trackers.sonic {folder}
        --trackers.twist2 {text}
        --import no_such_module
        """,
    ),
    ("evaluate --motions {clips}", "--horizon single\nnothing\n{text}\n{folder}\n{keyframes}"),
    (
        "play --policy {latent} --keyframes {keyframes} --hold 0.1",
        """
        ok
        --hold inf
        --policy nothing
        --policy {folder}
        --policy {text}
        --keyframes nothing.json
        --keyframes {text}
        --keyframes {folder}
        --keyframes {clips}
        --keyframes /dev/null
        --video new.txt
        --video new.gif
        --video {folder}
        --video {text}/below.mp4
        --video /proc/none/a.mp4
        --viewer
        --robot r2d2
        --import no_such_module
        """,
    ),
    (
        "studio {latent}",
        """
        --robot r2d2
        --keyframes nothing.json
        --keyframes {text}
        --folder nothing
        --folder {text}
        --host 300.300.300.300
        --host nowhere.invalid
        --motions nothing.npz
        --import no_such_module
        """,
    ),
    ("studio", "nothing\n{text}\n{folder}"),
    (
        "motions inspect",
        """
        ok {clips}
        ok {clips} --pictures 0
        nothing.npz
        {empty}
        {text}
        {folder}
        /dev/null
        /proc/self/mem
        {clips} --out {text}
        {clips} --out /proc/none
        {clips} --robot r2d2
        generated:val@nan
        generated:val@inf
        ok {clips} --fps 1000
        """,
    ),
    (
        "motions convert {clips} --out",
        """
        ok new.npz
        ok new --format csv
        new.npz --format csv
        new.csv
        {text}
        {text}/below.npz
        {folder}.npz/
        {folderlike}
        /proc/none.npz
        {fifo}
        ok {clips}
        new.npz --trim 100 0
        new.npz --trim 1 1.5
        ok new.npz --resample 1000
        new.npz --drop-bad --limits.min-seconds 1000
        new.npz --robot r2d2
        """,
    ),
    (
        "motions mirror",
        """
        {clips} --out {folderlike}
        {clips} --out /proc/none
        nothing.npz --out new.npz
        --out new.npz
        """,
    ),
    (
        "motions retarget",
        """
        nothing.bvh --out new
        {text} --out new
        {folder} --out new
        {bvh} --out new
        {bvh} --out {text}
        {bvh} --out /proc/none
        {bvh} --out new --map nothing.yaml
        {bvh} --out new --map {text}
        --out new
        """,
    ),
    (
        "keyframes from-motion {clips} --out",
        """
        ok new.json --clip run_a --every 0.5
        ok new.json --clip run_a --times 0.5 1
        new.json --every 0.5
        new.json --clip run_a
        new.json --clip nobody --every 0.5
        new.json --clip run_a --every 0.5 --times 1
        new.json --clip run_a --every 1e-9
        new.json --clip run_a --every 100
        new.json --clip run_a --times 100
        new.json --clip run_a --times 1 0.5
        new.json --clip run_a --times 0.5 0.5
        new.json --clip run_a --every 0.5 --names a
        new.json --clip run_a --every 0.5 --begin 100
        {folder} --clip run_a --every 0.5
        {text}/below.json --clip run_a --every 0.5
        /proc/none.json --clip run_a --every 0.5
        {fifo} --clip run_a --every 0.5
        new.json --clip run_a --every 0.5 --robot r2d2
        """,
    ),
    (
        "keyframes show",
        """
        ok {keyframes}
        nothing.json
        {text}
        {folder}
        {clips}
        /dev/null
        {keyframes} --robot r2d2
        ok {keyframes} --split
        {keyframes} --timing.control-dt 1e-12
        """,
    ),
    (
        "export",
        """
        nothing --out new
        {expert} --out new
        {text} --out new
        {folder} --out new
        {latent} --out {text}
        {latent} --out {text}/below
        {latent} --out /proc/none
        {latent} --out {filled}
        {latent} --out new --robot r2d2
        """,
    ),
    ("sim-to-sim", "nothing\n{text}\n{folder}\n{latent}\n{latent} --robot r2d2"),
    (
        "curves",
        """
        nothing
        {expert}
        {text}
        ok {trained} --metrics reward
        {trained} --metrics nothing
        {trained} --metrics
        {trained} --metrics reward --out {folder}
        {trained} --metrics reward --out new.xyz
        {trained} --metrics reward --out new
        {trained} --metrics reward --out {text}/below.png
        {trained} --metrics reward --out /proc/none.png
        {broken} --metrics reward
        """,
    ),
    (
        "ablations --runs {folder} --out new --motions {clips} --horizon single --num-envs 4 --device cpu",
        """
        ok --runs {tmp}
        --motions nothing.npz
        --runs nothing
        --runs {text}
        --out {text}
        --out /proc/none
        --hard [
        --train
        --train --training.motions nothing.npz
        --device cuda
        """,
    ),
    ("demo", "--out {text}\n--out /proc/none"),
)
ENVIRONMENTS: tuple[tuple[str, str], ...] = (
    ("MUJOCO_GL=osmesa", "play --policy {latent} --keyframes {keyframes} --hold 0.1 --video new.mp4"),
    ("MUJOCO_GL=osmesa", "ok play --policy {latent} --keyframes {keyframes} --hold 0.1"),
    ("MUJOCO_GL=glfw", "play --policy {latent} --keyframes {keyframes} --hold 0.1 --video new.mp4"),
    ("MUJOCO_GL=nonsense", "play --policy {latent} --keyframes {keyframes} --hold 0.1 --video new.mp4"),
    ("MUJOCO_GL=osmesa", "ok motions inspect {clips} --out new"),
    ("MUJOCO_GL=osmesa", "ok evaluate {latent} --motions {clips} --num-envs 4 --horizon single --device cpu"),
    ("PLAT_CACHE_DIR=/proc/none", "ok motions inspect {clips}"),
    ("PLAT_CACHE_DIR=/proc/none", "ok evaluate {expert} --motions {clips} --num-envs 4 --horizon single"),
    ("OMP_NUM_THREADS=0", "ok motions inspect {clips}"),
    ("HOME=/proc/none", "ok keyframes show {keyframes}"),
    ("TMPDIR=/proc/none", "ok keyframes show {keyframes}"),
    ("COLUMNS=1", "expert --num-envs 0"),
    ("LC_ALL=C PYTHONUTF8=0 PYTHONIOENCODING=ascii", "expert --num-envs 0"),
    ("LC_ALL=C PYTHONUTF8=0 PYTHONIOENCODING=ascii", "ok motions inspect {clips}"),
)


@dataclass(frozen=True)
class Case:
    """A command line.

    Attributes:
        words: behind ``plat``.
        right: whether it is right, and has to come to its end.
        environment: variables that are set for it; it has a process of its own then.
    """

    words: str
    right: bool = False
    environment: str = ""


@dataclass(frozen=True)
class Outcome:
    """What became of a case: empty ``fault`` if it held."""

    case: Case
    fault: str
    message: str
    seconds: float


def cases(parts: Sequence[tuple[str, str]] = (*QUICK, *FULL)) -> list[Case]:
    """Return the cases of tables of a command line and what is added to it."""
    found = []
    for base, lines in parts:
        for line in map(str.strip, lines.strip().splitlines()):
            right = line == "ok" or line.startswith("ok ")
            found.append(Case(f"{base} {line.removeprefix('ok')}".replace("{nothing}", "").strip(), right))
    return found


def environment_cases() -> list[Case]:
    """Return the cases that need a process of their own."""
    return [Case(line.removeprefix("ok "), line.startswith("ok "), variables) for variables, line in ENVIRONMENTS]


def props(folder: Path) -> dict[str, str]:
    """Make the files that the command lines speak of; return their paths by name."""
    from plat.keyframes import KeyframeSequence
    from plat.modules import Expert, ExpertConfig, LatentPolicy
    from plat.motions import load_motions
    from plat.robots import G1
    from tests.modules.policies.test_student import SMALL
    from tests.recipes.runs import save_run, write_motions

    clips = write_motions(folder)
    (folder / "note.txt").write_text("not what you think\n")
    (folder / "empty.npz").write_bytes(b"")
    (folder / "human.bvh").write_text("HIERARCHY\nROOT Hips\n{\n")
    for name in ("folder", "folder.npz", "filled", "expert", "latent"):
        (folder / name).mkdir()
    (folder / "filled" / "precious.txt").write_text("keep me\n")
    os.mkfifo(folder / "fifo.npz")  # no device of this machine: a program that replaces it does no harm
    for name, row in (("trained", "1,0.5,1.5"), ("broken", "1,zero,one")):
        (folder / name).mkdir()
        (folder / name / "metrics.csv").write_text(f"step,seconds,reward\n{row}\n")
    clip = load_motions(clips)[0]
    KeyframeSequence.from_motion(clip, [0.5, 1.0], G1).save(folder / "keyframes.json")
    save_run(folder / "expert", Expert(G1, ExpertConfig(hidden=(8,))), steps=100)
    save_run(folder / "latent", LatentPolicy(G1, SMALL), steps=100)
    paths = {
        "clips": "motions.npz",
        "text": "note.txt",
        "empty": "empty.npz",
        "bvh": "human.bvh",
        "fifo": "fifo.npz",
        "folderlike": "folder.npz",
        "keyframes": "keyframes.json",
        **{name: name for name in ("folder", "filled", "expert", "latent", "trained", "broken")},
    }
    return {"tmp": str(folder)} | {name: str(folder / path) for name, path in paths.items()}


class _Hang(BaseException):
    """Raised in a case that takes too long."""


def _alarm(*_: object) -> None:
    raise _Hang


def tried(case: Case, names: dict[str, str]) -> Outcome:
    """Run a case in an empty folder."""
    home, began = Path.cwd(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            words = shlex.split(case.words.format(**names))
            ended = (_in_process if case.environment else _here)(words, case.environment)
        finally:
            os.chdir(home)
        left = sorted(path.name for path in Path(folder).iterdir())
    return Outcome(case, _fault(case, ended, left), ended or "", time.monotonic() - began)


def _here(words: list[str], _: str) -> str | None:
    """Return how a command ended in this process; None for well."""
    from plat.cli import main

    signal.signal(signal.SIGPROF, _alarm)
    signal.signal(signal.SIGALRM, _alarm)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.setitimer(signal.ITIMER_REAL, WAITING)
    out = io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            main(words)
    except SystemExit as end:
        return None if end.code in (None, 0) else str(end.code)
    except _Hang:
        return f"no end within {SECONDS} s of work, or {WAITING} s of waiting"
    except BaseException:
        return traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
    return None


def _in_process(words: list[str], environment: str) -> str | None:
    """Do the same in a process with other environment variables."""
    variables = {**os.environ, **dict(pair.split("=", 1) for pair in environment.split())}
    command = [sys.executable, "-m", "plat", *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=variables, timeout=WAITING, check=False)
    except subprocess.TimeoutExpired:
        return f"no end within {WAITING} s"
    return (done.stderr.strip() or f"exit code {done.returncode}") if done.returncode else None


def _fault(case: Case, ended: str | None, left: list[str]) -> str:
    if ended is None:
        return "" if case.right else "was not refused"
    if case.right:
        return "did not come to its end"
    lines = [line for line in ended.strip().splitlines() if "Warning" not in line]
    if len(lines) != 1 or not lines[0].startswith("error: "):
        return "no line that begins with error:" if "Traceback" not in ended else "traceback"
    return f"leaves {', '.join(left)}" if left else ""


def outcomes(chosen: Sequence[Case], folder: Path) -> Iterator[Outcome]:
    """Run cases; their files are made in a folder, and have to be as they were at the end of each."""
    folder.mkdir()
    names = props(folder)
    before = contents(folder)
    for case in chosen:
        outcome = tried(case, names)
        changed = [str(path) for path in set(contents(folder).items()) ^ set(before.items())]
        if changed and not case.right:
            outcome = Outcome(case, f"changes {changed[0]}", outcome.message, outcome.seconds)
        if changed:
            shutil.rmtree(folder)
            folder.mkdir()
            names = props(folder)
            before = contents(folder)
        yield outcome


def contents(folder: Path) -> dict[str, int]:
    """Return the sizes of the files in a folder."""
    return {str(path): path.stat().st_size if path.is_file() else -1 for path in folder.rglob("*")}


def main() -> None:
    """Run the campaign; print what did not hold, and the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="only what is refused before any work")
    parser.add_argument("--work", action="store_true", help="only the others")
    parser.add_argument("--only", default="", help="only command lines in which this regular expression is found")
    parser.add_argument("--verbose", action="store_true", help="print the message of every case")
    chosen = parser.parse_args()
    everything = cases(QUICK) if chosen.quick else [*cases(), *environment_cases()]
    if chosen.work:
        everything = [*cases(FULL), *environment_cases()]
    everything = [case for case in everything if re.search(chosen.only, f"{case.environment} {case.words}")]
    held = 0
    with tempfile.TemporaryDirectory() as folder:
        for outcome in outcomes(everything, Path(folder) / "props"):
            held += not outcome.fault
            if outcome.fault or chosen.verbose:
                case = outcome.case
                print(f"{outcome.fault or 'held'} ({outcome.seconds:.1f} s): {case.environment} plat {case.words}")
                last = "\n".join(outcome.message.strip().splitlines()[-6 if outcome.fault == "traceback" else -2 :])
                print(f"    {last[:600]}", flush=True)
    print(f"{len(everything)} command lines, {held} held")
    sys.exit(held < len(everything))


if __name__ == "__main__":
    main()
