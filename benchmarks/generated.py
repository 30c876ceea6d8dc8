"""Metrics of the generated set: generation speed, soundness, and how far released trackers follow it.

python benchmarks/generated.py --trackers DIR

DIR holds ``twist2/twist2_1017_20k.onnx`` and ``wbc/policy_066ab15.onnx``; without it only generation and soundness are
measured. ``--expert expert-g1`` lets an expert of plat follow as
well. Trackers need the extra ``baselines``, and ``--sheets`` the extra ``video``.
"""

import logging
import time
from collections import Counter
from dataclasses import dataclass, fields
from itertools import groupby
from pathlib import Path

import numpy as np
import tyro

import plat.headless

# isort: split

import plat
from plat.baselines import Tracker, Twist2, Wbc, follow
from plat.evaluation import Entrant
from plat.motions import MotionClip, MotionLibrary, generate_motions, load_motions
from plat.motions.generation.soundness import Soundness, measure_soundness
from plat.rendering import Stage, stills, write_picture
from plat.robots import G1
from plat.runs import report_errors


@dataclass(kw_only=True)
class GeneratedBenchmark:
    """Settings of the benchmark of the generated motion set."""

    trackers: Path | None = None
    """folder of the released trackers"""
    split: str = "val"
    """split of the generated set"""
    seconds: float = 600.0
    """seconds of motion"""
    families: tuple[str, ...] = ()
    """only these families or groups; by default those of the plain set"""
    motions: tuple[str, ...] = ()
    """motion files to follow instead of the generated set (a check of the adapters)"""
    expert: str = ""
    """expert of plat that is to follow the clips, such as expert-g1"""
    every: int = 1
    """use every n-th clip of those files"""
    sheets: Path | None = None
    """folder for a contact sheet per family"""


class RedrawCounter(logging.Handler):
    """Counter of rejected draws by family."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.count: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        """Count a rejected draw."""
        self.count[family_of(str(record.args[0] if isinstance(record.args, tuple) else record.args))] += 1


def family_of(name: str) -> str:
    """Return a clip's family; other clips are grouped by their name before the first _."""
    return name.split("_")[0]


def by_family(clips: list[MotionClip]) -> dict[str, list[int]]:
    """Return the indices of the clips of each family."""
    numbers = sorted(range(len(clips)), key=lambda number: family_of(clips[number].name))
    groups = groupby(numbers, key=lambda number: family_of(clips[number].name))
    return {family: list(members) for family, members in groups}


def print_soundness(clips: list[MotionClip], redraws: Counter[str]) -> None:
    """Print the worst clip of each family, quantity by quantity."""
    names = [field.name for field in fields(Soundness)]
    print(f"\n{'family':<12}{'clips':>6}{'s':>7}{'redrawn':>9}" + "".join(f"{name:>18}" for name in names))
    for family, numbers in by_family(clips).items():
        found = [measure_soundness(G1, clips[number].qpos, 1 / clips[number].fps) for number in numbers]
        seconds = sum(clips[number].duration for number in numbers)
        worst = [(min if name == "balanced" else max)(getattr(one, name) for one in found) for name in names]
        line = f"{family:<12}{len(numbers):>6}{seconds:>7.0f}{redraws[family]:>9}"
        print(line + "".join(f"{value:>18.4f}" for value in worst))


def follow_by(tracker: Tracker | Entrant, clips: list[MotionClip]) -> tuple[list[str], list[float]]:
    """Return the clips' names and the fraction of each that a tracker follows."""
    library = MotionLibrary.from_clips(clips, tracker.robot)
    if isinstance(tracker, Entrant):
        view = tracker.view
        fractions = follow(tracker.policy, library, observe=lambda library, dense: view.transforms(library))
    else:
        fractions = follow(tracker, library)
    return library.clip_names, fractions.tolist()


def print_followed(clips: list[MotionClip], trackers: dict[str, Tracker | Entrant]) -> None:
    """Print the clips that each tracker followed to the end, family by family; their lengths are similar."""
    print(f"\n{'followed':<12}" + "".join(f"{name:>12}" for name in trackers))
    total: Counter[str] = Counter()
    lost: list[str] = []
    for family, numbers in by_family(clips).items():
        line = f"{family:<12}"
        for name, tracker in trackers.items():
            names, fractions = follow_by(tracker, [clips[number] for number in numbers])
            done = sum(fraction == 1 for fraction in fractions)
            total[name] += done
            line += f"{f'{done}/{len(fractions)}':>12}"
            lost += [
                f"{name} lost {clip} after {fraction:.0%}"
                for clip, fraction in zip(names, fractions, strict=True)
                if fraction < 1
            ]
        print(line, flush=True)
    print(f"{'all':<12}" + "".join(f"{f'{total[name]}/{len(clips)}':>12}" for name in trackers))
    print("\n".join(lost))


def write_sheets(folder: Path, clips: list[MotionClip]) -> None:
    """Write contact sheets: two clips of each family, eight pictures each."""
    stage = Stage(G1, width=220, height=170)
    for family, numbers in by_family(clips).items():
        rows = []
        for number in numbers[:2]:
            _, pictures = stills(stage, clips[number].qpos, 8)
            rows.append(np.concatenate(pictures[:, :, 45:175], 1))
        write_picture(folder / f"generated_{family}.png", np.concatenate(rows))
    stage.close()


def main(config: GeneratedBenchmark) -> None:
    """Measure and print."""
    if config.motions:
        clips = load_motions(config.motions)[:: config.every]
    else:
        redraws = RedrawCounter()
        logger = logging.getLogger("plat.motions.generation")
        logger.setLevel(logging.DEBUG)
        logger.addHandler(redraws)
        began, cpu = time.perf_counter(), time.process_time()
        clips = generate_motions(config.split, config.seconds, config.families)
        spent, cpu = time.perf_counter() - began, time.process_time() - cpu
        length = sum(clip.duration for clip in clips)
        print(f"{len(clips)} clips, {length:.0f} s of motion, made in {spent:.1f} s ({cpu:.1f} s of CPU)")
        print_soundness(clips, redraws.count)
    trackers: dict[str, Tracker | Entrant] = {}
    if config.expert:
        trackers[config.expert] = Entrant.of_policy(plat.load(config.expert), dense=True)
    if config.trackers is not None:
        trackers["TWIST2"] = Twist2(config.trackers / "twist2" / "twist2_1017_20k.onnx")
        trackers["wbc"] = Wbc(config.trackers / "wbc" / "policy_066ab15.onnx")
    if trackers:
        print_followed(clips, trackers)
    if config.sheets is not None:
        write_sheets(config.sheets, clips)


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(GeneratedBenchmark))
