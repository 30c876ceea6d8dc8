"""Make keyframe files out of motions, and look at them.

plat keyframes from-motion generated:val/bow@1 --every 0.7 --out bow.json
plat keyframes show bow.json
plat keyframes around crossed_arms.json --out led_around.json
plat keyframes convert g1_with_keys.xml --out keys.json
"""

import shlex
from collections.abc import Sequence
from dataclasses import fields
from itertools import pairwise

import numpy as np

from plat.cli.options import Around, ConvertKeyframes, FromMotion, KeyframesCommand, Show
from plat.cli.together import check_effect
from plat.control import Feasibility, Simulator, lead_around
from plat.control.chase import check_start
from plat.errors import KeyframeError
from plat.files import check_file, keep_sources
from plat.keyframes import Keyframe, KeyframeSequence, standing
from plat.keyframes.files import holds_keyframes, keyframe_json, keyframes_of, write_keyframes
from plat.keyframes.keyframe import check_whole
from plat.keyframes.kimodo import constraints_of, write_constraints
from plat.keyframes.mjcf_keys import read_mjcf_keys, write_mjcf_keys
from plat.motions import MotionClip, load_motions
from plat.motions.generation import PREFIX, generate_named
from plat.robots import Robot, get_robot
from plat.spec.parts import Parts
from plat.spec.timing import Timing
from plat.words import counted, in_table

# of times that are written (s)
_ROUNDING = 1e-6


def from_motion(command: FromMotion) -> KeyframeSequence:
    """Write the file; return what is in it."""
    check_file(command.out, suffixes=(".json",))
    clip = _clip(command)
    if bool(command.times) == (command.every is not None):
        raise KeyframeError("keyframes of a motion: expected either --times or --every")
    times = command.times if command.every is None else _spread(command, command.every, clip.duration)
    names, timing = command.names or None, command.timing
    sequence = KeyframeSequence.from_motion(
        clip, times, get_robot(command.robot), begin=command.begin, names=names, timing=timing
    )
    sequence.save(command.out)
    print(f"wrote {command.out}: {counted(len(sequence), 'keyframe')} in {sequence.duration:g} s of {clip.name!r}")
    return sequence


def _clip(command: FromMotion) -> MotionClip:
    make = generate_named if command.motion.startswith(PREFIX) else load_motions
    clips = make(command.motion, get_robot(command.robot))
    chosen = [clip for clip in clips if command.clip in (clip.name, None)]
    if len(chosen) != 1:
        told = "its name" if len(clips) == 1 else f"the name of one of {len(clips)}"
        names = ", ".join(clip.name for clip in clips[:5]) + (", ..." if len(clips) > 5 else "")
        raise KeyframeError(f"motion {command.motion!r}: expected --clip with {told}: {names}")
    return chosen[0]


def _spread(command: FromMotion, every: float, end: float) -> list[float]:
    control_dt, longest = command.timing.control_dt, command.timing.longest
    if not control_dt <= every <= longest:
        raise KeyframeError(f"every is {every:g} s, expected {control_dt:g} to {longest:g} (--timing.max-steps)")
    if command.begin >= end:
        raise KeyframeError(f"begin is {command.begin:g} s, expected less than the {end:g} s of the clip")
    # the small margin is for clips that last a multiple of it up to rounding
    parts = int(np.ceil((end - command.begin) / every - 1e-6))
    even = np.linspace(command.begin, end, parts + 1)[1:]
    # on control steps, for that is when keyframes are commanded
    return [min(command.begin + command.timing.steps(time - command.begin) * control_dt, end) for time in even]


def show(command: Show) -> KeyframeSequence:
    """Print the table; return what is in the file."""
    robot = get_robot(command.robot)
    sequence = KeyframeSequence.load(
        command.file, robot, split=command.split, timing=command.timing, tell=lambda interval: print(interval.words)
    )
    print(
        f"{command.file}: {counted(len(sequence), 'keyframe')} for {sequence.robot.name!r} in {sequence.duration:g} s"
    )
    print(f"{'':>3}  {'name':<20}  {'time s':>7}  {'steps':>5}  {'root x y z m':>20}  most changed joint")
    before, step = sequence.start, 0
    for index, (keyframe, arrival) in enumerate(zip(sequence.keyframes, sequence.arrival_steps, strict=True)):
        parts = keyframe.commands or Parts.all(robot)
        places = zip(keyframe.root_pos, parts.root_place, strict=True)
        root = " ".join(f"{value:>6.2f}" if commanded else f"{'-':>6}" for value, commanded in places)
        print(
            f"{index:>3}  {in_table(keyframe.name):<20.20}  {keyframe.time:>7.2f}  {arrival - step:>5}  {root:>20}  "
            f"{_most_changed(before, keyframe, parts, robot)}"
        )
        if not keyframe.whole:
            print(f"     commands {_words(parts, robot)}")
        before, step = keyframe, arrival
    feasibility = Feasibility(robot)
    try:
        check_start(sequence, Simulator.of(robot, sequence.timing.control_dt), command.file)
    except KeyframeError as error:
        print(error)  # what is looked at may be as it is
    else:
        if concerns := feasibility(sequence.start, sequence.start.at(1.0), held=True):
            print(f"a robot at rest cannot stay in the start: {'; '.join(map(str, concerns))}")
    lengths = [after - before for before, after in pairwise((0, *sequence.arrival_steps))]
    for index, concerns in enumerate(feasibility.sequence(sequence)):
        if concerns:
            way = any(concern.measure == "way_penetration" for concern in concerns)
            room = lengths[index] > 1 and not command.split
            advice = f": {_led_around(command)} puts one between" if way and room else ""
            print(f"keyframe {index} may be out of reach: {'; '.join(map(str, concerns))}{advice}")
    return sequence


def _led_around(command: Show) -> str:
    """Return the command line that puts keyframes on the ways of the file that is shown."""
    out = command.file.with_name(f"{command.file.stem}_around.json")
    robot = f" --robot {shlex.quote(command.robot)}" if command.robot != type(command).robot else ""
    changed = [one for one in fields(Timing) if getattr(command.timing, one.name) != one.default]
    timing = "".join(f" --timing.{one.name.replace('_', '-')} {getattr(command.timing, one.name)}" for one in changed)
    return f"plat keyframes around {shlex.quote(str(command.file))} --out {shlex.quote(str(out))}{robot}{timing}"


def around(command: Around) -> KeyframeSequence:
    """Write the file; return what is in it."""
    check_file(command.out, suffixes=(".json",))
    keep_sources([command.file], [command.out])
    drawn = KeyframeSequence.load(command.file, get_robot(command.robot), timing=command.timing)
    try:
        sequence = lead_around(drawn)
    except KeyframeError as error:
        raise KeyframeError(f"keyframe file {str(command.file)!r}: {error}") from None
    sequence.save(command.out)
    added = len(sequence) - len(drawn)
    told = f"{added} of them on the way to others" if added else "as they were: every straight way is clear"
    print(f"wrote {command.out}: {counted(len(sequence), 'keyframe')}, {told}")
    return sequence


def _most_changed(before: Keyframe, after: Keyframe, parts: Parts, robot: Robot) -> str:
    """Return the commanded joint that changes most, and by how much."""
    if not any(parts.joints):
        return "-"
    change = after.joint_pos - before.joint_pos
    joint = int(np.where(parts.joints, np.abs(change), -1.0).argmax())
    return f"{robot.joint_names[joint]} {change[joint]:+.2f} rad"


def _words(parts: Parts, robot: Robot) -> str:
    """Return the names of what is commanded."""
    every = Parts.all(robot).names(robot)
    chosen = {field: names for field, names in parts.names(robot).items() if names}
    return "; ".join(
        f"{field} {'all' if names == every[field] else ', '.join(names)}" for field, names in chosen.items()
    )


def convert(command: ConvertKeyframes) -> list[Keyframe]:
    """Write the file; return the poses that are in it, the start first."""
    if command.kimodo and command.out.suffix.lower() == ".xml":
        raise KeyframeError(f"--kimodo --out {command.out}: constraints are JSON, expected a name that ends in .json")
    check_file(command.out, suffixes=(".json", ".xml"))
    keep_sources([command.file], [command.out])
    robot = get_robot(command.robot)
    poses, told, heard = _poses(command, robot)
    for line in told:
        print(line)
    if poses[0].time > 0:
        poses.insert(0, standing(robot))
    _check_order(command, poses)
    poses = [_checked(command, number, pose, robot) for number, pose in enumerate(poses)]
    # a keyframe file has a keyframe behind its start
    alone = len(poses) == 1 and _to_keyframes(command)
    check_effect(
        "--fps",
        command.fps != type(command).fps,
        "--kimodo or a file of constraints",
        command.kimodo or heard == "--fps",
    )
    check_effect(
        "--every", command.every != type(command).every, "keys that have no times", alone or heard == "--every"
    )
    form = "MJCF keys" if command.out.suffix.lower() == ".xml" else "keyframes"
    if command.out.suffix.lower() == ".xml":
        write_mjcf_keys(command.out, robot, poses)
    elif command.kimodo:
        form = "constraints"
        write_constraints(command.out, robot, poses, command.fps)
        moved = max(abs(round(pose.time * command.fps) / command.fps - pose.time) for pose in poses)
        if moved > _ROUNDING:
            print(f"times moved to the nearest frames, {command.fps:g} a second: by up to {moved:.2g} s")
    else:
        start, *others = poses
        if not others:
            others = [start.at(command.every)]
        write_keyframes(command.out, robot, start, others)
    print(f"wrote {command.out}: {counted(len(poses), 'pose')} as {form}, the first at {poses[0].time:g} s")
    return poses


def _checked(command: ConvertKeyframes, number: int, pose: Keyframe, robot: Robot) -> Keyframe:
    try:
        return pose.checked(robot)
    except KeyframeError as error:
        called = f" ({pose.name!r})" if pose.name else ""
        raise KeyframeError(f"{str(command.file)!r}: pose {number}{called}: {error}") from None


def _check_order(command: ConvertKeyframes, poses: list[Keyframe]) -> None:
    if poses[0].time < 0:
        raise KeyframeError(
            f"{str(command.file)!r}: pose 0 is at {poses[0].time:g} s, expected times from 0 on: shift all of them"
        )
    timing = Timing()
    to_keyframes = _to_keyframes(command)  # files of keys and of constraints hold any times
    for number, (before, after) in enumerate(pairwise(poses), 1):
        if after.time <= before.time:
            expected = "later than"
        elif to_keyframes and timing.steps(after.time) <= timing.steps(before.time):
            expected = f"at least {timing.control_dt:g} s after"
        else:
            continue
        raise KeyframeError(
            f"{str(command.file)!r}: pose {number} is at {after.time:g} s, expected {expected} the one before it, "
            f"at {before.time:g} s"
        )


def _check_partial(command: ConvertKeyframes, start: Keyframe | None, others: Sequence[Keyframe]) -> None:
    """Raise for a keyframe that commands parts of its pose where whole poses are needed.

    Raises:
        KeyframeError: naming the file and its keyframe.
    """
    where = f"keyframe file {str(command.file)!r}"
    if not _to_keyframes(command):  # the writers know only the file that they write
        check_whole(others, where, "these constraints" if command.kimodo else "MJCF keys")
    if start is None and others and others[0].time == 0 and not others[0].whole:
        raise KeyframeError(
            f"{where}: keyframe 0: time is 0 s, expected at least {Timing().control_dt:g} s after 0 s: as the start it "
            "would not command its parts"
        )


def _to_keyframes(command: ConvertKeyframes) -> bool:
    return command.out.suffix.lower() == ".json" and not command.kimodo


def _poses(command: ConvertKeyframes, robot: Robot) -> tuple[list[Keyframe], list[str], str]:
    """Return the poses of a file in any of the forms, in the order of their times, lines for the user, and the option
    that their times depend on, ``""`` for none.
    """
    if command.file.suffix.lower() in (".xml", ".mjcf"):
        keys = read_mjcf_keys(command.file, robot)
        times = [key.time for key in keys]
        if len(set(times)) > 1 or len(times) == 1:
            return keys, [], ""  # those out of order are refused
        told = f"its keys have no times of their own: {command.every:g} s apart"
        return [key.at((number + 1) * command.every) for number, key in enumerate(keys)], [told], "--every"
    content = keyframe_json(command.file)
    if holds_keyframes(content):
        start, others = keyframes_of(content, command.file, robot)
        if not others:
            raise KeyframeError(f"keyframe file {str(command.file)!r}: no keyframes, expected at least one")
        _check_partial(command, start, others)
        return [*([] if start is None else [start]), *others], [], ""
    poses, left_out = constraints_of(content, command.file, robot, command.fps)
    return poses, [f"left out: {', '.join(left_out)}"] if left_out else [], "--fps"


def main(command: KeyframesCommand) -> KeyframeSequence | list[Keyframe]:
    """Run a command; return the sequence."""
    if isinstance(command, ConvertKeyframes):
        return convert(command)
    if isinstance(command, Around):
        return around(command)
    return from_motion(command) if isinstance(command, FromMotion) else show(command)
