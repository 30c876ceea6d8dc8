"""Several ways to one goal: how far apart a policy's robots pass when noise varies them, and how many still arrive.

python benchmarks/ways.py dagger-g1 imagined-g1 --motions hard_free_val.npz --steps 50

Robots begin in the same state with the same command, and differ in noise alone: on the latent, in units of the prior's
own standard deviation, or on the action. It is doubled until a tenth of the commands is lost. ``held`` noise is drawn
once a robot, as a style would be; the other is new at each step. Policies compare at equal loss: the last table has how
far apart robots pass, and still are at their arrival, where ``--lost`` percent of the commands is lost.

With a latent a policy acts on one side here, as it does where it is sampled; one without is as it is deployed.
"""

from collections.abc import Iterator
from dataclasses import astuple, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import torch
import tyro
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn

from plat.bounds import Bounded, Count, Positive, Seed
from plat.envs.transforms import CommandSchedule
from plat.errors import ConfigError, MotionError
from plat.evaluation.records import CommandRecorder
from plat.evaluation.rollout import make_evaluation_env
from plat.evaluation.setting import EvaluationSetting
from plat.files import replace_table
from plat.modules import FinetunedPolicy, LatentPolicy
from plat.modules.deployed import timed
from plat.motions import MotionClip, MotionLibrary
from plat.runs import load_policy, report_errors
from plat.runs.policies import Policy, deployed
from plat.spec.timing import Timing, timing_of
from plat.words import percent

Space = Literal["latent", "action"]
FIRST_SCALE: dict[Space, float] = {"latent": 0.5, "action": 0.05}
"""Least noise: in standard deviations of the prior, and in units of action."""
DOUBLINGS = 10
GIVEN_UP = 0.1
"""Share of the commands that may be lost before noise is not doubled any more."""


@dataclass(kw_only=True)
class WaysConfig(Bounded):
    """Settings of the benchmark of ways to one goal."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """runs, or names such as dagger-g1"""
    motions: str
    """motion file, folder or glob"""
    steps: Count = 50
    """length of the commands in control steps"""
    commands: Count = 64
    """commands, evenly spread over the motions"""
    samples: Count = 8
    """robots for each"""
    lost: Positive = 2.0
    """percent of the commands by which robots compare"""
    seeds: tuple[Seed, ...] = (0, 1, 2)
    """of the commands and the noise"""
    csv: Path | None = None
    """file for the rows"""


@dataclass(frozen=True)
class Ways:
    """Ways of some robots to the same keyframes.

    Attributes:
        met: share of the commands that were met.
        apart: mean distance between two robots that met the same command, over keypoints and steps (m).
        at_arrival: the same at the last step (m).
        jerk: mean jerk of the joints (rad/s^3).
    """

    met: float
    apart: float
    at_arrival: float
    jerk: float

    def cells(self) -> list[str]:
        """Return them as they stand in a table: in percent, mm and rad/s^3."""
        return [percent(100 * self.met), f"{1e3 * self.apart:.1f}", f"{1e3 * self.at_arrival:.1f}", f"{self.jerk:.0f}"]


class Noise(nn.Module):
    """Gaussian noise on what a policy computes for some robots.

    Args:
        scale: standard deviation, in units of the second argument of the call if there is one.
        held: draw once for each robot, rather than at each step.
        seed: of the noise.
    """

    def __init__(self, scale: float, held: bool, seed: int):
        super().__init__()
        self.scale, self.held = scale, held
        self._generator = torch.Generator().manual_seed(seed)
        self._drawn: Tensor | None = None

    def forward(self, loc: Tensor, unit: Tensor | None = None) -> Tensor:
        """Return ``loc`` ``[N, n]`` with noise."""
        if self._drawn is None or not self.held:
            self._drawn = torch.randn(loc.shape, generator=self._generator)
        noise = self.scale * self._drawn
        return loc + (noise if unit is None else noise * unit)


def varied(policy: Policy, space: Space, noise: Noise) -> TensorDictModuleBase:
    """Return a policy's deterministic composition with noise on its latent or its action.

    Raises:
        ConfigError: for noise in the latent of a policy without one.
    """
    on_action = TensorDictModule(noise, in_keys=["action"], out_keys=["action"])
    acts: list[TensorDictModuleBase]
    if isinstance(policy, LatentPolicy | FinetunedPolicy):
        student = policy.student if isinstance(policy, FinetunedPolicy) else policy
        before, keys = policy.shown()
        acts = [*before, student.features(keys)]
        if space == "latent":
            on_latent = TensorDictModule(noise, in_keys=[student.mode, ("prior", "scale")], out_keys=["latent"])
            acts += [on_latent, student.decoder.using("hidden", "latent")]
        else:
            acts += [student.decoder.using("hidden", student.mode), on_action]
    elif space == "latent":
        raise ConfigError(f"ways: {type(policy).__name__} has no prior, expected a LatentPolicy or a FinetunedPolicy")
    else:
        acts = [deployed(policy), on_action]
    return timed(TensorDictSequential(*acts), timing_of(policy) or Timing())


def pieces(library: MotionLibrary, steps: int, commands: int, samples: int, seed: int) -> MotionLibrary:
    """Return pieces of motions that are one command long, each as often as it has samples.

    Raises:
        MotionError: when no motion is long enough.
    """
    long_enough = (library.clip_length > steps).nonzero()[:, 0]
    if not len(long_enough):
        raise MotionError(f"ways: no motion has more than {steps} control steps, which is the length of a command")
    generator = torch.Generator().manual_seed(seed)
    clips = []
    for number, row in enumerate(torch.linspace(0, len(long_enough) - 1, commands).long().tolist()):
        clip = library.clip(int(long_enough[row]))
        first = int(torch.randint(len(clip.qpos) - steps, (), generator=generator))
        clips.append(MotionClip(f"{number}", clip.qpos[first : first + steps + 1], clip.fps))
    of_command = MotionLibrary.from_clips(clips, library.robot, library.dt)
    return of_command.only(*(command for command in range(commands) for _ in range(samples)))


def follow(policy: TensorDictModuleBase, library: MotionLibrary, samples: int) -> Ways:
    """Let a robot follow each piece of motion, all of one length, as one command; return how they went."""
    steps = int(library.clip_length[0]) - 1
    schedule = CommandSchedule.of_arrivals(library, [[steps]] * library.num_clips)
    recorder = CommandRecorder(library, schedule)
    setting = EvaluationSetting(timing=timing_of(policy))
    task = make_evaluation_env(library, schedule, library.num_clips, setting=setting)
    places = []
    for step in task.steps(policy):
        recorder.add(step["motion", "frame"], task.active, step["next"])
        places.append(step["next", "state", "keypoint_pos_w"])
    task.close()
    records = recorder.records()
    met = ~records.failed.view(-1, samples)
    # [T, N, K, 3] to robots of a command beside each other; those that failed were put elsewhere and do not count
    paths = torch.stack(places).unflatten(1, met.shape).permute(1, 0, 3, 2, 4)
    distances = torch.cdist(paths, paths).mean(2)
    pairs = (met[:, :, None] & met[:, None, :]).triu(1)
    apart = distances.permute(0, 2, 3, 1)[pairs]  # [pairs, T]
    assert records.jerk_steps is not None  # counted where it was not given
    jerk = records.step["joint_jerk"].sum() / records.jerk_steps.sum()
    return Ways(float(met.float().mean()), float(apart.mean()), float(apart[:, -1].mean()), float(jerk))


def sweep(
    policy: Policy, space: Space, held: bool, library: MotionLibrary, samples: int, seed: int, least: float
) -> Iterator[tuple[float, Ways]]:
    """Yield the ways with ever more noise, until less than a share of the commands is met."""
    scale, met = FIRST_SCALE[space], 1.0
    for _ in range(DOUBLINGS):
        if met < least:
            return
        ways = follow(varied(policy, space, Noise(scale, held, seed)), library, samples)
        yield scale, ways
        scale, met = 2 * scale, ways.met


def at_loss(series: list[Ways], lost: float) -> Ways | None:
    """Return the ways where a share of the commands is lost, between the two nearest of a sweep; None if none is."""
    wanted = series[0].met - lost
    for before, after in pairwise(series):
        if after.met <= wanted:
            share = (before.met - wanted) / (before.met - after.met)
            return Ways(*((1 - share) * a + share * b for a, b in zip(astuple(before), astuple(after), strict=True)))
    return None


def main(config: WaysConfig) -> dict[tuple[str, Space, bool], list[Ways | None]]:
    """Run the benchmark: print and write a row for each policy, noise and seed; return the ways at equal loss.

    There is a value for each seed; None where that share of the commands was never lost.
    """
    rows: list[list[str]] = []
    found: dict[tuple[str, Space, bool], list[Ways | None]] = {}

    def note(*cells: str) -> None:
        rows.append(list(cells))
        print("  ".join(f"{cell:>17}" for cell in cells), flush=True)

    for run in config.runs:
        policy = load_policy(run)
        motions = MotionLibrary.load(config.motions, policy.robot)
        has_latent = isinstance(policy, LatentPolicy | FinetunedPolicy)
        spaces: tuple[Space, ...] = ("latent", "action") if has_latent else ("action",)
        for seed in config.seeds:
            library = pieces(motions, config.steps, config.commands, config.samples, seed)
            none = follow(varied(policy, "action", Noise(0.0, True, seed)), library, config.samples)
            note(str(run), str(seed), "none", "0", *none.cells())
            for space, held in ((space, held) for space in spaces for held in (True, False)):
                series, kind = [none], f"{space}, {_when(held)}"
                for scale, ways in sweep(policy, space, held, library, config.samples, seed, none.met - GIVEN_UP):
                    series.append(ways)
                    note(str(run), str(seed), kind, f"{scale:g}", *ways.cells())
                found.setdefault((str(run), space, held), []).append(at_loss(series, config.lost / 100))
    if config.csv is not None:
        columns = ("policy", "seed", "noise", "scale", "met_percent", "apart_mm", "at_arrival_mm", "jerk_rad_s3")
        replace_table(config.csv, list(columns), rows)
    print(f"\nat {config.lost:g} % lost: apart / at arrival (mm) / jerk (rad/s^3), a column for each seed")
    for (name, space, held), at_equal_loss in found.items():
        cells = ("never lost" if ways is None else " / ".join(ways.cells()[1:]) for ways in at_equal_loss)
        print(f"{name:>24}  {space:>6}  {_when(held):>9}  ", "  ".join(f"{cell:>22}" for cell in cells))
    return found


def _when(held: bool) -> str:
    return "held" if held else "each step"


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(WaysConfig, description=__doc__))
