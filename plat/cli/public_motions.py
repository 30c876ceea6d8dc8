"""Motions of the benchmark that anyone can get: which files of which public data set, and how they are read."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import torch

from plat.errors import PlatError
from plat.files import replace_file
from plat.motions.clip import MotionClip
from plat.motions.files import load_motions, save_motions
from plat.motions.paths import find_files
from plat.motions.resample import resample_qpos
from plat.motions.split import split_of
from plat.robots import Robot
from plat.words import counted

__all__ = ["PUBLIC", "PublicMotions"]

_RATE = 50.0  # frames a second, of captures whose rates differ


def _plain(stem: str) -> str:
    return stem


def _trial(stem: str) -> str:
    """Return the name of one of CMU's trials as its own archive has it; others write ``005_03`` for ``05_03``."""
    found = re.fullmatch(r"(\d+)_(\d+)", stem)
    return f"{int(found[1]):02d}_{int(found[2]):02d}" if found else stem


def _resampled(clip: MotionClip) -> MotionClip:
    qpos = resample_qpos(torch.from_numpy(clip.qpos), clip.fps, 1 / _RATE).numpy()
    return replace(clip, qpos=qpos, fps=_RATE)


@dataclass(frozen=True)
class PublicMotions:
    """Public data set, of which some files are for validation: weights that come with plat have not seen them.

    Attributes:
        option: of the command line, without dashes; also the name of the section.
        says: what it is, and its license.
        endings: of its motion files.
        clips: family of each validation motion by the name of its file, without folder and ending; None for those of
            the split val, see :func:`plat.motions.split.split_of`.
        fps: of files that do not say it.
        folder: name of the folder that the files lie in, where others have files of the same name.
        named: name in ``clips`` of a file's name, where there are several ways to write it.
    """

    option: str
    says: str
    endings: frozenset[str]
    clips: Mapping[str, str] | None = None
    fps: float | None = None
    folder: str | None = None
    named: Callable[[str], str] = _plain

    def file(self, source: Path, out: Path, robot: Robot) -> Path:
        """Return the motion file of the validation motions: read and retarget those of a folder, once.

        Args:
            source: folder with the data set's files; or a motion file, which is returned as it is.
            out: folder that ``motions/NAME_val.npz`` is written in.
            robot: that the motions are for.

        Raises:
            PlatError: when the folder has none of the files.
        """
        if source.is_file():
            return source
        path = out / "motions" / f"{self.option}_val.npz"
        if path.exists():
            print(f"motions of an earlier start: {path}; remove it to read {source} again", flush=True)
            return path
        found: dict[str, Path] = {}
        for each in find_files(source, set(self.endings)):
            name = self.named(each.stem)
            wanted = split_of(name) == "val" if self.clips is None else name in self.clips
            if wanted and self.folder in (None, each.parent.name):
                found.setdefault(name, each)
        flag, endings = self.option.replace("_", "-"), " or ".join(sorted(self.endings))
        which = "of the split val" if self.clips is None else f"of the names {', '.join(self.clips)}"
        if not found:
            raise PlatError(f"--{flag} {str(source)!r}: no {endings} file {which} in it")
        missing = [] if self.clips is None else [name for name in self.clips if name not in found]
        told = f", without {', '.join(missing)}" if missing else ""
        print(f"{self.option}: reading {counted(len(found), 'file')}{told}", flush=True)
        clips = load_motions(list(found.values()), robot, fps=self.fps)
        if len({clip.fps for clip in clips}) > 1:  # a file has one rate, and captures of an archive may have several
            clips = [_resampled(clip) for clip in clips]
        replace_file(path, lambda part: save_motions(part, clips, robot))
        return path

    def families(self, clips: list[str]) -> list[str]:
        """Return the families of motions by their names.

        >>> PUBLIC["g1_moves"].families(["M_Move18"])
        ['fight']
        """
        assert self.clips is not None
        return [self.clips.get(self.named(clip), "other") for clip in clips]


_DANCE = ("B_WiggleDance", "J_ShortDance16_JazzWalk")
_KARATE = ("M_Move18", "M_Move19")
_CMU = {
    "run": ("16_36", "127_04"),
    "run_stop": ("127_20",),
    "run_turn": ("16_38", "16_39", "16_43"),
    "walk_turn": ("16_24",),
    "jump": ("13_19", "14_08", "118_11", "127_25"),
    "dance": ("05_03",),
    "low": ("127_38",),
    "acrobatics": ("49_07",),
}
_HDM05 = {
    "jump": ("bd_hopBothLegs1hops_008", "tr_hopBothLegs1hops_034"),
    "fight": ("bd_kickLFront1Reps_001", "bk_kickLFront1Reps_009", "tr_kickLFront1Reps_028"),
    "sport": ("bd_throwBasketball_002",),
    "low": (
        *("bk_depositFloorR_008", "dg_depositFloorR_013", "dg_depositFloorR_016"),
        *("bk_sneak2StepsLStart_005", "mm_sneak2StepsLStart_013"),
        *("bk_squat1Reps_013", "dg_squat1Reps_033"),
        *("tr_squat1Reps_045", "tr_squat1Reps_046", "tr_squat1Reps_052"),
    ),
    "run_turn": (
        "dg_jogLeftCircle4StepsRstart_010",
        "mm_jogLeftCircle4StepsRstart_011",
        "mm_jogLeftCircle4StepsRstart_013",
    ),
}

_SETS = (
    PublicMotions("bandai", "Bandai-Namco Research Motion Dataset, split val", frozenset({".bvh"})),
    PublicMotions(
        "g1_moves",
        "g1-moves (Experiential Technologies, CC BY 4.0), dance and karate",
        frozenset({".csv"}),
        MappingProxyType(dict.fromkeys(_DANCE, "dance") | dict.fromkeys(_KARATE, "fight")),
        fps=60.0,
        folder="retarget",
    ),
    PublicMotions(
        "cmu",
        "CMU Graphics Lab Motion Capture Database (CMU's terms), hard motion",
        frozenset({".amc", ".bvh"}),
        MappingProxyType({trial: family for family, trials in _CMU.items() for trial in trials}),
        named=_trial,
    ),
    PublicMotions(
        "hdm05",
        "HDM05 (Max Planck Institute, CC BY-SA 3.0), hard motion of its cuts",
        frozenset({".amc"}),
        MappingProxyType({f"HDM_{cut}_120": family for family, cuts in _HDM05.items() for cut in cuts}),
    ),
)
PUBLIC: Mapping[str, PublicMotions] = MappingProxyType({each.option: each for each in _SETS})
"""Public data sets of the benchmark by their option, in the order of its sections."""
