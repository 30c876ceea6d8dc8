"""Make keyframe files out of motions, and look at them.

plat keyframes from-motion generated:val/bow@1 --every 0.7 --out bow.json
plat keyframes show bow.json
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from plat.errors import KeyframeError
from plat.keyframes import KeyframeSequence
from plat.motions import MotionClip, load_motions
from plat.motions.generation import PREFIX, generate_named
from plat.robots import G1
from plat.spec.timing import Timing


@dataclass(kw_only=True)
class FromMotion:
    """Take poses of a clip as keyframes."""

    motion: Annotated[str, tyro.conf.Positional]
    """motion file, folder or glob; "generated:val/bow@1" for a motion that plat makes itself"""
    out: Path
    """keyframe file to write"""
    clip: str | None = None
    """name of the clip, where there are several"""
    times: tuple[float, ...] = ()
    """seconds of the clip at which the keyframes are"""
    every: float | None = None
    """instead: evenly to the end of the clip, at most so many seconds apart"""
    names: tuple[str, ...] = ()
    """of the keyframes, in their order"""
    begin: float = 0.0
    """second of the clip in which the sequence begins"""
    timing: Timing = Timing()
    """of the policy that is to chase them"""

    def run(self) -> KeyframeSequence:
        """Write the file; return what is in it."""
        clip = self._clip()
        if bool(self.times) == (self.every is not None):
            raise KeyframeError("keyframes of a motion: expected either --times or --every")
        times = self.times if self.every is None else self._spread(self.every, clip.duration)
        if self.names and len(self.names) != len(times):
            raise KeyframeError(f"names: {len(self.names)} for {len(times)} keyframes, expected one for each or none")
        names, timing = self.names or None, self.timing
        sequence = KeyframeSequence.from_motion(clip, times, G1, begin=self.begin, names=names, timing=timing)
        sequence.save(self.out)
        print(f"wrote {self.out}: {len(sequence)} keyframes in {sequence.duration:g} s of {clip.name!r}")
        return sequence

    def _clip(self) -> MotionClip:
        clips = generate_named(self.motion) if self.motion.startswith(PREFIX) else load_motions(self.motion)
        chosen = [clip for clip in clips if self.clip in (clip.name, None)]
        if len(chosen) != 1:
            names = ", ".join(clip.name for clip in clips[:5]) + (", ..." if len(clips) > 5 else "")
            raise KeyframeError(
                f"motion {self.motion!r}: expected --clip with the name of one of {len(clips)}: {names}"
            )
        return chosen[0]

    def _spread(self, every: float, end: float) -> list[float]:
        control_dt, longest = self.timing.control_dt, self.timing.longest
        if not control_dt <= every <= longest:
            raise KeyframeError(f"every is {every:g} s, expected {control_dt:g} to {longest:g}")
        # the small margin is for clips that last a multiple of it up to rounding
        parts = int(np.ceil((end - self.begin) / every - 1e-6))
        even = np.linspace(self.begin, end, parts + 1)[1:]
        # on control steps, for that is when keyframes are commanded
        return [min(self.begin + self.timing.steps(time - self.begin) * control_dt, end) for time in even]


@dataclass(kw_only=True)
class Show:
    """Check a file and print what is in it."""

    file: Annotated[Path, tyro.conf.Positional]
    """keyframe file"""
    split: bool = False
    """split intervals longer than the policy's longest command into equal parts"""
    timing: Timing = Timing()
    """of the policy that is to chase them"""

    def run(self) -> KeyframeSequence:
        """Print the table; return what is in the file."""
        sequence = KeyframeSequence.load(self.file, G1, split=self.split, timing=self.timing)
        print(f"{self.file}: {len(sequence)} keyframes for {sequence.robot.name!r} in {sequence.duration:g} s")
        print(f"{'':>3}  {'name':<20}  {'time s':>7}  {'steps':>5}  {'root x y z m':>20}  most changed joint")
        before, step = sequence.start, 0
        for index, (keyframe, arrival) in enumerate(zip(sequence.keyframes, sequence.arrival_steps, strict=True)):
            change = keyframe.joint_pos - before.joint_pos
            joint = int(np.abs(change).argmax())
            root = " ".join(f"{value:>6.2f}" for value in keyframe.root_pos)
            print(
                f"{index:>3}  {keyframe.name or '':<20.20}  {keyframe.time:>7.2f}  {arrival - step:>5}  {root:>20}  "
                f"{sequence.robot.joint_names[joint]} {change[joint]:+.2f} rad"
            )
            before, step = keyframe, arrival
        return sequence


COMMAND = FromMotion | Show


def main(command: FromMotion | Show) -> None:
    """Run a command."""
    command.run()
