"""Settings of the commands, apart from what runs so that help texts need no torch."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import tyro

from plat.baselines.released import ReleasedTrackers
from plat.bounds import Bounded, Count, Fraction, Natural, NonNegative, NotEmpty, Positive, Range, Robots, Seed
from plat.envs.settings import HOLD, ReachLimits
from plat.envs.transforms.settings import RandomizationRanges
from plat.evaluation.names import DisturbanceName, Interface, RuleName
from plat.modules.settings import WalkingReach
from plat.motions.checks.settings import ValidationLimits
from plat.motions.retargeting.options import SolverOptions
from plat.pools import available_cpus
from plat.runs.loggers import LoggerName, chosen_loggers
from plat.runs.user_modules import Imports
from plat.spec.timing import Timing

__all__ = [
    "AverageRecipe",
    "BaselinesRecipe",
    "BenchmarkRecipe",
    "Convert",
    "CurvesRecipe",
    "EvaluateRecipe",
    "ExportRecipe",
    "FromMotion",
    "HorizonName",
    "Imports",
    "Inspect",
    "KeyframesCommand",
    "Map",
    "Mirror",
    "MotionFiles",
    "MotionsCommand",
    "PlayRecipe",
    "Retarget",
    "ScoringConfig",
    "Show",
    "SimToSimRecipe",
    "StudioRecipe",
]


Rate: TypeAlias = Annotated[float, Range(1, 1000)]
"""Frames a second."""

HorizonName = Literal["single", "short", "medium", "long", "mixed", "distant", "all"]


PartKind: TypeAlias = Literal[
    "hands", "hands_and_head", "hands_and_feet", "root", "upper_body", "legs", "bodies", "joints"
]
"""Kind of partial keyframes, see :data:`plat.envs.part_masks.PART_KINDS`."""


@dataclass(kw_only=True)
class ScoringConfig(Bounded):
    """What the recipes that score policies have in common."""

    trackers: ReleasedTrackers = field(default_factory=ReleasedTrackers)
    motions: Annotated[tuple[str, ...], NotEmpty()]
    """motion files, folders or globs; "generated:val" or "generated:test" for generated motion"""
    horizon: Annotated[tuple[HorizonName, ...], NotEmpty()] = ("single", "short", "medium", "long", "mixed")
    """lengths of the commands; distant and all are for policies with longer commands"""
    randomization: RandomizationRanges = RandomizationRanges()
    """ranges of the domain randomization, and pushes"""
    clip: str | None = None
    """film strips show the first motion whose name this matches; by default the first of all"""
    seed: Seed = 0
    """draws the commands, and the disturbances"""
    num_envs: Robots = 256
    """robots simulated at a time; no score depends on it"""
    wandb: bool = False
    """log table and figures to Weights & Biases; offline unless you are logged in"""
    trackio: bool = False
    """log table and figures to trackio, which keeps its files on this machine"""
    workers: Natural = 0
    """processes to spread motions over, 0 for one a core; the figures do not depend on it"""
    device: str = "auto"
    """device of networks and tensors; by default "cuda" where there is one"""
    robot: str = "g1"
    """name of the robot, or path of its JSON description"""
    imports: Imports = ()
    """module that registers custom policy classes"""

    @property
    def loggers(self) -> tuple[LoggerName, ...]:
        """Return the experiment loggers that were asked for."""
        return chosen_loggers(self.wandb, self.trackio)


@dataclass(kw_only=True)
class EvaluateRecipe(ScoringConfig):
    """Score policies on motions."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """runs, names such as plat-g1, bundles, or .onnx files of released trackers"""
    partial: PartKind | None = None
    """score partial keyframes of a kind; policies for whole poses cannot follow them"""
    only: str | None = None
    """regular expression: score only motions whose names it matches, as in run|kick"""
    dense: bool = False
    """show policies the reference instead of the keyframe: how well a dense tracker tracks"""
    interface: Annotated[tuple[Interface, ...], NotEmpty()] = ("next-frame",)
    """how dense trackers are shown a keyframe; with several, the table has each"""
    whole_clips: tuple[RuleName, ...] = ()
    """success rules to judge whole clips by, each followed once from its first frame"""
    manifest: tuple[Path, ...] = ()
    """CSV files with the columns clip and family: scores by family"""
    difficulty: bool = False
    """scores by difficulty, measured from the motion"""
    robustness: tuple[DisturbanceName, ...] = ()
    """disturbances of growing strength: TKS@3 against each"""
    out: Path | None = None
    """folder for records and tables; the same command resumes from it"""
    authored: Natural = 0
    """chains per family of authored keyframes to score as well: arms, steps, crouch and so on"""
    pushes: NonNegative = 0.0
    """push robots on authored keyframes every 1.5 s: change of their horizontal velocity (m/s)"""
    strips: Path | None = None
    """folder to draw a film strip of each authored family into, as PDF and PNG"""
    domain_randomization: bool = False
    """draw robot, motors and ground for each motion, and push the robots"""
    disturbed: Fraction = 0.0
    """strength of all disturbances: the above, delays, load, noise; 1 is the full set"""
    csv: Path | None = None
    """file for every figure and interval; authored keyframes go to NAME_authored.csv"""
    figures: Path | None = None
    """folder to draw radar plot, bars, success curves and film strips into, as PDF and PNG"""


@dataclass(kw_only=True)
class BenchmarkRecipe(Bounded):
    """Score policies and released trackers on public motions, in one table."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """runs, names such as plat-g1, bundles, or .onnx files of released trackers"""
    out: Path
    """folder for the table, figures and records; the same command resumes from it"""
    trackers: ReleasedTrackers = field(default_factory=ReleasedTrackers)
    bandai: Path | None = None
    """folder of Bandai-Namco's .bvh files, retargeted here; or an .npz of them for the G1"""
    g1_moves: Path | None = None
    """clone of experientialtech/g1-moves: its validation motions, dance and karate on the G1"""
    cmu: Path | None = None
    """folder of CMU's .amc and .asf, or .bvh files: its validation trials, retargeted here"""
    hdm05: Path | None = None
    """folder of HDM05's cut .amc and .asf files: its validation cuts, retargeted here"""
    hard: tuple[Path, ...] = ()
    """.npz files of hard motion, a section for each"""
    manifest: tuple[Path, ...] = ()
    """CSV files with the columns clip and family of the hard motion"""
    generated: Positive = 300.0
    """seconds of generated motion, of the split test"""
    longest: Positive = 10.0
    """longer motions are cut into equal pieces of at most this many seconds"""
    clips: Natural = 0
    """motions of each set, spread evenly; 0 for all"""
    horizons: Annotated[tuple[str, ...], NotEmpty()] = ("single", "short", "medium", "long", "mixed")
    """horizons of the first set of motions"""
    further_horizons: Annotated[tuple[str, ...], NotEmpty()] = ("long", "mixed")
    """horizons of the other sets"""
    interface: Annotated[tuple[Interface, ...], NotEmpty()] = ("next-frame", "line", "cascade")
    """how dense trackers are shown a keyframe; the table shows the best of each"""
    rules: Annotated[tuple[RuleName, ...], NotEmpty()] = ("humantracker", "supermimic")
    """success rules of whole clips"""
    robustness: tuple[DisturbanceName, ...] = ("push", "friction", "payload", "latency", "motors", "noise")
    """disturbances of growing strength, on the first set of motions"""
    strengths: Count = 5
    """strengths of each disturbance, spread evenly over those that there are"""
    robustness_clips: Count = 64
    """motions for the disturbances, spread evenly"""
    authored: Natural = 30
    """chains of each family of authored keyframes, on the first set of motions; 0 for none"""
    ours: str | None = None
    """row that is compared with each other one; by default the first"""
    seed: Seed = 0
    """draws commands and disturbances"""
    num_envs: Robots = 256
    """robots simulated at a time"""
    workers: Natural = 0
    """processes to spread motions over, 0 for one a core; the figures do not depend on it"""
    device: str = "auto"
    """device of networks and tensors; by default "cuda" where there is one"""
    robot: str = "g1"
    """name of the robot, or path of its JSON description"""
    imports: Imports = ()
    """module that registers custom policy classes"""


@dataclass(kw_only=True)
class BaselinesRecipe(Bounded):
    """List the released trackers that plat can run."""

    files: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """files to identify by their SHA-256; without any, the list of trackers is printed"""


@dataclass(kw_only=True)
class PlayRecipe(Bounded):
    """Let a policy chase the keyframes of a file."""

    policy: Path
    """run, or a name such as plat-g1; an expert sees the keyframe as its next frame (Scratch RL)"""
    keyframes: Path
    """keyframe file, see docs/keyframes.md; plat keyframes makes them out of motions"""
    split: bool = False
    """split intervals longer than the longest command into equal parts; else they are refused"""
    hold: Annotated[float, Range(0, infinite=True)] = HOLD
    """seconds to hold the last keyframe after its arrival; "inf" with --viewer"""
    push: NonNegative = 0.0
    """shove the robot: change of its horizontal velocity (m/s), in a random direction"""
    push_every: Positive = 1.5
    """seconds from shove to shove"""
    seed: Seed = 0
    """draws the directions"""
    reach: ReachLimits = field(default_factory=ReachLimits)
    video: Path | None = None
    """MP4 to write: the keyframe as a ghost, the time left as a bar, the outcome in words"""
    csv: Path | None = None
    """file for the outcome of each keyframe, and its errors"""
    viewer: bool = False
    """watch it live in MuJoCo's viewer; needs a display"""
    robot: str = "g1"
    """robot of the policy: its name, or path of its JSON description"""
    imports: Imports = ()
    """module that registers custom policy classes"""


@dataclass(kw_only=True)
class StudioRecipe(Bounded):
    """Open the keyframe studio, a web page."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional] = (
        Path("imagined-g1"),
        Path("plat-g1"),
        Path("dagger-g1"),
        Path("expert-g1"),
    )
    """runs, or names such as plat-g1; an expert sees the keyframe as its next frame (Scratch RL)"""
    motions: str = "generated:val"
    """motion files, folders or globs to take poses from, separated by spaces"""
    keyframes: Path | None = None
    """keyframe file to open"""
    folder: Path = Path()
    """only folder that the page writes to, and reads keyframes from; motions it reads anywhere"""
    host: str = "127.0.0.1"
    """address to listen on; one beyond localhost asks visitors for a token, which is printed"""
    port: Annotated[int, Range(1, 65_535)] = 8080
    """port to listen on"""
    browser: bool = True
    """open the page in the browser, where there is a screen"""
    static: Path | None = None
    """folder to make: write the page as files that need no server, and end"""
    libraries: Path | None = None
    """node_modules with what the static page needs; without, it loads that from jsdelivr.net"""
    robot: str = "g1"
    """robot of the policy: its name, or path of its JSON description"""
    imports: Imports = ()
    """module that registers custom policy classes"""


@dataclass(kw_only=True)
class MotionFiles(Bounded):
    """Motion files, and how to read them."""

    files: Annotated[tuple[str, ...], tyro.conf.Positional]
    """motion files, folders or globs; "generated:val" for generated motions"""
    quat_order: Literal["wxyz", "xyzw"] | None = None
    """order of the root quaternion in these files, where they do not show it"""
    fps: Rate | None = None
    """frames a second of these files, where they do not state it, or state it wrongly"""
    up: Literal["x", "y", "z"] | None = None
    """axis that points up in these files, where they do not show it"""
    units: Literal["m", "cm", "mm", "in", "ft"] | None = None
    """of lengths in these files, where they do not show it"""
    angles: Literal["degrees", "radians"] | None = None
    """unit of angles in .bvh and .amc, where they do not show it"""
    strict: bool = False
    """stop at the first bad file of a folder, read copies; else they are named and left out"""
    robot: str = "g1"
    """name of the robot, or path of its JSON description"""


@dataclass(kw_only=True)
class Inspect(MotionFiles):
    """Measure clips and say whether they are fit to train on."""

    out: Path | None = None
    """folder for a contact sheet and a plot a clip"""
    pictures: Count = 20
    """how many clips get them, those to drop or repair first"""
    limits: ValidationLimits = field(default_factory=ValidationLimits)


@dataclass(kw_only=True)
class Convert(MotionFiles):
    """Write clips as plat npz or csv, repaired where asked."""

    out: Path
    """a file .npz for all clips, or a folder"""
    format: Literal["npz", "csv"] = "npz"
    """in a folder: an .npz for each file, or a .csv (wxyz, with a header) for each clip"""
    trim: tuple[NonNegative, NonNegative] = (0.0, 0.0)
    """seconds to trim from start and end of each clip, before it is cut"""
    ground: Literal["clip", "smooth"] | None = None
    """put the feet on the floor: all frames of a clip alike, or following a floor that drifts"""
    level_feet: bool = False
    """turn the ankles of standing feet until their soles are level (motion from video)"""
    smooth_steps: bool = False
    """spread isolated single-frame steps of joints over 0.15 s to both sides"""
    clip_limits: bool = False
    """clip joint angles to their limits"""
    resample: Rate | None = None
    """frames a second to write, for files of different rates"""
    repair: bool = False
    """repair what inspect asks for, and nothing else; prints verdicts before and after"""
    cut: bool = False
    """cut clips where they jump between frames, and leave out pieces that are too short"""
    drop_bad: bool = False
    """leave out what is to be dropped, after the repairs"""
    limits: ValidationLimits = field(default_factory=ValidationLimits)


@dataclass(kw_only=True)
class Mirror(MotionFiles):
    """Write the mirror image of every clip, left and right exchanged."""

    out: Path
    """a file .npz for all clips, or a folder for an .npz for each file"""


@dataclass(kw_only=True)
class Retarget(Bounded):
    """Turn human motion capture (BVH, ASF and AMC, joint positions in npz) into motions of the G1."""

    files: Annotated[tuple[str, ...], tyro.conf.Positional]
    """.bvh, .amc, .npz and .npy files, folders or globs; an .amc wants its .asf beside it"""
    out: Path
    """folder to write to"""
    map: Path | None = None
    """skeleton map (YAML), see docs/retargeting.md; by default a shipped one"""
    fps: Rate | None = None
    """frames a second of these files, where they do not state it, or state it wrongly"""
    up: Literal["x", "y", "z"] | None = None
    """axis that points up in these files, where they do not show it"""
    units: Literal["m", "cm", "mm", "in", "ft", "in/0.45"] | None = None
    """of lengths in these files, where they do not show it"""
    angles: Literal["degrees", "radians"] | None = None
    """unit of angles in .bvh and .amc, where they do not show it"""
    split: bool = False
    """write train.npz, val.npz and test.npz by clip name instead of a file per capture"""
    workers: Annotated[int, Range(1, 1024)] = field(default_factory=lambda: min(available_cpus(), 1024))
    """processes to spread the files over, at most; a few files are done in one"""
    solver: SolverOptions = SolverOptions()
    """settings of inverse kinematics"""


@dataclass(kw_only=True)
class Map(Bounded):
    """Draw captures with the skeleton map that fits, or that is proposed and written as YAML."""

    files: Annotated[tuple[str, ...], tyro.conf.Positional]
    """.bvh, .amc, .npz and .npy files, folders or globs; one of a kind is enough"""
    out: Path
    """folder for <name>_map.png, and <name>_map.yaml of a proposed map"""
    map: Path | None = None
    """skeleton map (YAML) to look at; by default a shipped one, else a proposed one"""


@dataclass(kw_only=True)
class FromMotion(Bounded):
    """Take poses of a clip as keyframes."""

    motion: Annotated[str, tyro.conf.Positional]
    """motion file, folder or glob; "generated:val/bow@1" for a generated motion"""
    out: Path
    """keyframe file to write"""
    clip: str | None = None
    """name of the clip, where there are several"""
    times: tuple[NonNegative, ...] = ()
    """seconds of the clip at which the keyframes are"""
    every: Positive | None = None
    """instead: evenly spaced to the end of the clip, at most this many seconds apart"""
    names: tuple[str, ...] = ()
    """of the keyframes, in their order"""
    begin: NonNegative = 0.0
    """second of the clip in which the sequence begins"""
    robot: str = "g1"
    """name of the robot, or path of its JSON description"""
    timing: Timing = Timing()
    """of the policy that is to chase them"""


@dataclass(kw_only=True)
class ConvertKeyframes(Bounded):
    """Bring keyframes from or to an MJCF file with keys, or Kimodo's constraints."""

    file: Annotated[Path, tyro.conf.Positional]
    """keyframe file, .xml with <key> elements, or .json of Kimodo's constraints"""
    out: Path
    """file to write: .xml for MJCF, .json else"""
    kimodo: bool = False
    """write Kimodo's constraints instead of a keyframe file"""
    fps: Rate = 30.0
    """frames a second that constraints count; 30 for Kimodo"""
    every: Annotated[float, Range(0.02, 60)] = 1.0
    """seconds between keys of an .xml that have no times"""
    robot: str = "g1"
    """name of the robot, or path of its JSON description"""


@dataclass(kw_only=True)
class Show(Bounded):
    """Check a file and print what is in it."""

    file: Annotated[Path, tyro.conf.Positional]
    """keyframe file"""
    split: bool = False
    """split intervals longer than the policy's longest command into equal parts"""
    robot: str = "g1"
    """name of the robot, or path of its JSON description"""
    timing: Timing = Timing()
    """of the policy that is to chase them"""


@dataclass(kw_only=True)
class Around(Bounded):
    """Put a keyframe wherever the straight way to the next leads through the robot."""

    file: Annotated[Path, tyro.conf.Positional]
    """keyframe file"""
    out: Path
    """keyframe file to write"""
    robot: str = "g1"
    """name of the robot, or path of its JSON description"""
    timing: Timing = Timing()
    """of the policy that is to chase them"""


@dataclass(kw_only=True)
class ExportRecipe(Bounded):
    """Write the policy of a run as a bundle for robots and other simulators."""

    run: Annotated[Path, tyro.conf.Positional]
    """run of stage 2 or 3, or plat-g1; scores in its evaluation.csv are taken along"""
    out: Path
    """folder to make"""
    robot: str = "g1"
    """robot of the policy: its name, or path of its JSON description"""
    imports: Imports = ()
    """module that registers custom policy classes"""


@dataclass(kw_only=True)
class SimToSimRecipe(Bounded):
    """Run a bundle in MuJoCo at other physics than it was trained in."""

    bundle: Annotated[Path, tyro.conf.Positional]
    """folder that plat export wrote"""
    motions: tuple[str, ...] = ("generated:val@60",)
    """motion files, folders or globs to take keyframes from; may be empty"""
    keyframes: tuple[Path, ...] = ()
    """keyframe files to run as well"""
    split: bool = False
    """split intervals longer than the longest command into equal parts; else they are refused"""
    robot: str = "g1"
    """name of the robot, or path of its JSON description"""
    seed: Seed = 0
    """draws the keyframes' times in each motion, 0.02 to 1 s apart"""


@dataclass(kw_only=True)
class AverageRecipe(Bounded):
    """Average the weights of runs."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """run directories, or names of shipped weights; settings are those of the last"""
    out: Path
    """folder to write the average to"""
    shares: tuple[Positive, ...] = ()
    """weight of each run in the average; equal if there are none"""
    symmetric: bool = False
    """let it act by the mean of its action and the mirrored one; one run will do"""
    reach: WalkingReach | None = None
    """show a student keyframes beyond it nearer; one run will do"""
    robot: str = "g1"
    """robot of the policies: its name, or path of its JSON description"""
    imports: Imports = ()
    """module that registers custom policy classes"""


@dataclass(kw_only=True)
class CurvesRecipe(Bounded):
    """Draw learning curves."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """run directories, one line each"""
    metrics: tuple[str, ...] = ()
    """columns of metrics.csv, one panel each; by default failures, and errors or costs"""
    out: Path = Path("curves.png")
    """picture to write (PNG, PDF or SVG)"""
    smooth: Count = 5
    """rows that are averaged"""


MotionsCommand: TypeAlias = Inspect | Convert | Mirror | Retarget | Map
KeyframesCommand: TypeAlias = FromMotion | Show | Around | Annotated[ConvertKeyframes, tyro.conf.subcommand("convert")]
