import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plat.cli import keyframes, main
from plat.errors import KeyframeError, MotionError, OutputError, PlatError
from plat.keyframes import Keyframe, KeyframeSequence, only, standing
from plat.keyframes.files import write_keyframes
from plat.keyframes.mjcf_keys import write_mjcf_keys
from plat.motions import generate_motions, save_motions
from plat.robots import G1
from plat.spec.timing import Timing
from tests.crossed import ABOVE, BELOW

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "recipes" / "examples" / "bow.json"


def test_the_example_is_what_the_recipe_makes(tmp_path):
    names = ("lean", "bow", "stay", "rise", "stand")
    command = keyframes.FromMotion(motion="generated:val/bow@1", every=0.71, names=names, out=tmp_path / "a.json")
    made = keyframes.main(command)
    example = KeyframeSequence.load(EXAMPLE, G1)
    assert [keyframe.name for keyframe in example.keyframes] == list(names)
    for ours, theirs in zip((made.start, *made.keyframes), (example.start, *example.keyframes), strict=True):
        assert ours.time == theirs.time
        np.testing.assert_allclose(ours.qpos, theirs.qpos, atol=1e-3)


def test_keyframes_are_spread_evenly_to_the_end_of_the_clip(tmp_path):
    command = keyframes.FromMotion(motion="generated:val/bow@1", every=0.5, begin=0.3, out=tmp_path / "a.json")
    made = keyframes.main(command)
    clip = generate_motions("val", seconds=1, families=("bow",))[0]
    assert made.duration == pytest.approx(clip.duration - 0.3)
    steps = np.diff((0, *made.arrival_steps))
    assert steps.max() <= 25
    assert np.ptp(steps) <= 1
    np.testing.assert_allclose(made.keyframes[-1].joint_pos, clip.qpos[-1, 7:], atol=1e-6)


def test_times_and_a_clip_of_a_file_are_chosen(tmp_path):
    clips = generate_motions("val", seconds=8)
    save_motions(tmp_path / "two.npz", clips)
    recipe = {"motion": str(tmp_path / "two.npz"), "out": tmp_path / "a.json"}
    made = keyframes.main(keyframes.FromMotion(**recipe, clip=clips[1].name, times=(0.5, 1.0)))
    np.testing.assert_allclose(made.start.qpos, clips[1].qpos[0], atol=1e-6)
    assert [keyframe.time for keyframe in made.keyframes] == [0.5, 1.0]
    with pytest.raises(KeyframeError, match=f"expected --clip .* one of 2: {clips[0].name}, {clips[1].name}$"):
        keyframes.main(keyframes.FromMotion(**recipe, times=(0.5,)))
    save_motions(tmp_path / "two.npz", clips[:1])
    with pytest.raises(KeyframeError, match=f"expected --clip with its name: {clips[0].name}$"):
        keyframes.main(keyframes.FromMotion(**recipe, clip="other", times=(0.5,)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "expected either --times or --every"),
        ({"times": (0.5,), "every": 0.5}, "expected either --times or --every"),
        ({"every": 2.0}, "every is 2 s, expected 0.02 to 1"),
        ({"times": (0.5,), "names": ("a", "b")}, "names: 2 for 1 keyframe,"),
        ({"times": (0.5, 1.9)}, "keyframe 1: time is 1.9 s, 70 control steps after 0.5 s"),
    ],
)
def test_what_makes_no_sequence_is_refused(tmp_path, arguments, message):
    with pytest.raises(KeyframeError, match=message):
        keyframes.main(keyframes.FromMotion(motion="generated:val/bow@1", out=tmp_path / "a.json", **arguments))
    assert not (tmp_path / "a.json").exists()


def test_a_motion_that_is_not_there_is_named(tmp_path):
    with pytest.raises(MotionError, match="nowhere.npz"):
        keyframes.main(keyframes.FromMotion(motion="nowhere.npz", every=0.5, out=tmp_path / "a.json"))


def test_show_prints_a_row_a_keyframe(capsys):
    keyframes.main(keyframes.Show(file=EXAMPLE))
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 2 + 5
    assert "bow" in rows[3]
    assert "left_hip_pitch" in rows[3]


def test_arms_are_led_around(tmp_path, capsys):
    file, out = tmp_path / "crossed.json", tmp_path / "led.json"
    write_keyframes(file, G1, standing(G1), (ABOVE, BELOW))
    led = keyframes.main(keyframes.Around(file=file, out=out))
    assert capsys.readouterr().out == f"wrote {out}: 3 keyframes, 1 of them on the way to others\n"
    assert [keyframe.time for keyframe in KeyframeSequence.load(out, G1).keyframes] == [1.0, 1.5, 2.0]
    keyframes.main(keyframes.Show(file=file))
    assert f"on the straight way there: plat keyframes around {file} --out" in capsys.readouterr().out
    keyframes.main(keyframes.Show(file=out))
    assert "may be out of reach" not in capsys.readouterr().out
    assert len(led) == 3
    keyframes.main(keyframes.Around(file=out, out=tmp_path / "again.json"))
    assert capsys.readouterr().out.endswith("again.json: 3 keyframes, as they were: every straight way is clear\n")
    with pytest.raises(OutputError, match="crossed.json"):
        keyframes.main(keyframes.Around(file=file, out=file))


def test_the_command_that_leads_around_is_for_the_same_file_robot_and_timing(tmp_path, capsys):
    file = tmp_path / "crossed arms.json"
    write_keyframes(file, G1, standing(G1), (ABOVE, BELOW.at(3.0)))
    keyframes.main(keyframes.Show(file=file, timing=Timing(max_steps=150)))
    advised = re.search("plat (keyframes around .*) puts one between", capsys.readouterr().out)[1]
    assert advised.endswith(" --timing.max-steps 150")
    main(shlex.split(advised))
    assert len(KeyframeSequence.load(tmp_path / "crossed arms_around.json", G1, timing=Timing(max_steps=150))) == 3
    keyframes.main(keyframes.Show(file=file, split=True))
    assert "plat keyframes around" not in capsys.readouterr().out  # which splits nothing


def test_a_step_has_no_room_for_a_keyframe_on_its_way(tmp_path, capsys):
    file = tmp_path / "tight.json"
    write_keyframes(file, G1, standing(G1), (ABOVE, BELOW.at(ABOVE.time + 0.02)))
    keyframes.main(keyframes.Show(file=file))
    assert "on the straight way there\n" in capsys.readouterr().out  # and no command that would be refused
    with pytest.raises(KeyframeError, match=r"tight.json': keyframe at 1.02 s: a control step after the one before"):
        keyframes.main(keyframes.Around(file=file, out=tmp_path / "out.json"))


def test_names_stay_in_their_rows(tmp_path, capsys):
    names = ("a\nb", "\x1b[31mred")
    poses = [replace(standing(G1).at(0.5 * number), name=name) for number, name in enumerate(names, 1)]
    write_keyframes(tmp_path / "odd.json", G1, standing(G1), poses)
    keyframes.main(keyframes.Show(file=tmp_path / "odd.json"))
    rows = capsys.readouterr().out.splitlines()
    assert [row[5:20].strip() for row in rows[2:4]] == ["a\\nb", "\\x1b[31mred"]


def test_one_keyframe_is_called_one(tmp_path, capsys):
    write_keyframes(tmp_path / "one.json", G1, standing(G1), [standing(G1).at(0.5)])
    keyframes.main(keyframes.Show(file=tmp_path / "one.json"))
    assert capsys.readouterr().out.startswith(f"{tmp_path / 'one.json'}: 1 keyframe for 'g1' in 0.5 s\n")


def test_show_names_what_partial_keyframes_command(tmp_path, capsys):
    arms = only(G1, 0.5, joints={"left_elbow": 0.4, "right_elbow": 0.9})
    away = only(G1, 1.0, root=(0.1, 0.2), base=arms)
    hand = only(G1, 1.5, left_hand=(0.3, 0.2, 1.0), height=0.7)
    KeyframeSequence(G1, standing(G1), (arms, away, hand, standing(G1).at(2.0))).save(tmp_path / "parts.json")
    keyframes.main(keyframes.Show(file=tmp_path / "parts.json"))
    rows = [line for line in capsys.readouterr().out.splitlines()[2:] if "out of reach" not in line]
    assert [row.strip() for row in rows[1:6:2]] == [
        "commands joints left_elbow, right_elbow",
        "commands root horizontal",
        "commands bodies left_wrist_yaw_link; root height",
    ]
    assert [row.split()[3:] for row in rows[0:5:2]] == [
        ["-", "-", "-", "right_elbow", "+0.30", "rad"],
        ["0.10", "0.20", "-", "-"],
        ["-", "-", "0.70", "-"],
    ]
    assert len(rows) == 7  # that of the whole keyframe is as ever


def test_an_interval_that_is_too_long_comes_with_the_ways_out(tmp_path, capsys):
    stand = standing(G1)
    write_keyframes(tmp_path / "slow.json", G1, stand, [stand.at(2.5)])
    with pytest.raises(
        KeyframeError,
        match=r"expected at most 50 \(1 s\): .*--split of plat play, plat sim-to-sim and .*--timing.max-steps of plat",
    ):
        keyframes.main(keyframes.Show(file=tmp_path / "slow.json"))
    assert len(keyframes.main(keyframes.Show(file=tmp_path / "slow.json", split=True))) == 3
    assert capsys.readouterr().out.startswith("keyframe 0 comes 2.5 s after the one before")
    with pytest.raises(KeyframeError, match=r"every is 2 s, expected 0.02 to 1 \(--timing.max-steps\)"):
        keyframes.main(keyframes.FromMotion(motion="generated:val/bow@1", every=2.0, out=tmp_path / "a.json"))


def test_show_tells_what_is_out_of_reach(tmp_path, capsys):
    stand = standing(G1)
    away = Keyframe(1.0, stand.root_pos + np.array([2.5, 0, 0]), stand.root_quat, stand.joint_pos)
    KeyframeSequence(G1, stand, (stand.at(0.5).at(0.2), away)).save(tmp_path / "far.json")
    keyframes.main(keyframes.Show(file=tmp_path / "far.json"))
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "out of reach" in line]
    assert line.startswith("keyframe 1 may be out of reach: 2.5 m in 0.80 s takes ")


def test_show_tells_a_start_that_cannot_be_played(tmp_path, capsys):
    stand = standing(G1)
    low = replace(stand, root_pos=stand.root_pos - [0, 0, 0.56])
    KeyframeSequence(G1, low, (stand.at(0.5),)).save(tmp_path / "low.json")
    keyframes.main(keyframes.Show(file=tmp_path / "low.json"))
    assert "low.json': start: the robot is 56 cm inside the floor, expected a start on it\n" in capsys.readouterr().out


def test_show_tells_a_start_that_no_robot_stays_in(tmp_path, capsys):
    stand = standing(G1)
    for height in (0.0, 0.2):
        start = replace(stand, root_pos=stand.root_pos + height * np.eye(3)[2])
        KeyframeSequence(G1, start, (stand.at(0.5),)).save(tmp_path / "start.json")
        keyframes.main(keyframes.Show(file=tmp_path / "start.json"))
        said = capsys.readouterr().out
        told = "\na robot at rest cannot stay in the start: the feet are 20 cm above the floor\n" in said
        assert told == (height > 0)


def test_keyframes_to_mjcf_and_constraints_and_back(tmp_path, capsys):
    def convert(source: Path, out: str, **more: object) -> KeyframeSequence | None:
        keyframes.main(keyframes.ConvertKeyframes(file=source, out=tmp_path / out, **more))
        return KeyframeSequence.load(tmp_path / out, G1) if out.startswith("plat") else None

    example = KeyframeSequence.load(EXAMPLE, G1)
    convert(EXAMPLE, "keys.xml")
    convert(tmp_path / "keys.xml", "constraints.json", kimodo=True)
    for source in ("keys.xml", "constraints.json"):
        found = convert(tmp_path / source, "plat.json")
        for ours, theirs in zip(found.keyframes, example.keyframes, strict=True):
            assert ours.time == pytest.approx(theirs.time, abs=1 / 60)
            np.testing.assert_allclose(ours.qpos, theirs.qpos, atol=1e-4)
    text = (tmp_path / "keys.xml").read_text()
    for time in (0, *(keyframe.time for keyframe in example.keyframes)):
        text = text.replace(f' time="{time:.9g}"', "")
    (tmp_path / "untimed.xml").write_text(text)
    found = convert(tmp_path / "untimed.xml", "plat.json", every=0.5)
    assert [keyframe.time for keyframe in found.keyframes] == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    assert "its keys have no times of their own: 0.5 s apart" in capsys.readouterr().out


@pytest.mark.parametrize("times", [("2", "1", "3"), ("0.4", "0.9", "0.9")])
def test_keys_with_times_out_of_order_are_refused(tmp_path, times):
    stand = standing(G1)
    write_keyframes(tmp_path / "three.json", G1, stand.at(0.25), [stand.at(0.5), stand.at(0.75)])
    keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "three.json", out=tmp_path / "keys.xml"))
    text = (tmp_path / "keys.xml").read_text()
    written = re.findall(r' time="[^"]*"', text)
    for old, new in zip(written, times[-len(written) :], strict=True):
        text = text.replace(old, f' time="{new}"', 1)
    (tmp_path / "keys.xml").write_text(text)
    with pytest.raises(KeyframeError, match=r"keys.xml': pose \d is at .* s, expected later than the one before it"):
        keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "keys.xml", out=tmp_path / "out.json"))
    assert not (tmp_path / "out.json").exists()


def test_what_is_written_can_be_read(tmp_path):
    stand = standing(G1)
    write_mjcf_keys(tmp_path / "close.xml", G1, [stand, stand.at(0.5), stand.at(0.505)])
    with pytest.raises(KeyframeError, match=r"close.xml': pose 2 is at 0.505 s, expected at least 0.02 s after"):
        keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "close.xml", out=tmp_path / "out.json"))
    assert not (tmp_path / "out.json").exists()
    keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "close.xml", out=tmp_path / "out.xml"))


@pytest.mark.parametrize("start", [True, False])
@pytest.mark.parametrize("out", ["out.xml", "out.json"])
def test_a_file_without_keyframes_is_refused(tmp_path, start, out):
    write_keyframes(tmp_path / "some.json", G1, standing(G1), [standing(G1).at(1.0)])
    content = json.loads((tmp_path / "some.json").read_text())
    if not start:
        del content["start"]
    (tmp_path / "none.json").write_text(json.dumps({**content, "keyframes": []}))
    with pytest.raises(KeyframeError, match=r"none.json': no keyframes, expected at least one"):
        keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "none.json", out=tmp_path / out))
    assert not (tmp_path / out).exists()


@pytest.mark.parametrize("more", [{}, {"kimodo": True}])
def test_keys_before_the_start_are_refused(tmp_path, more):
    stand = standing(G1)
    write_mjcf_keys(tmp_path / "early.xml", G1, [stand.at(-1.0), stand.at(0.5), stand.at(1.0)])
    with pytest.raises(KeyframeError, match=r"early.xml': pose 0 is at -1 s, expected times from 0 on: shift all"):
        keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "early.xml", out=tmp_path / "out.json", **more))
    assert not (tmp_path / "out.json").exists()


@pytest.mark.parametrize("out", ["out.json", "out.xml"])
def test_a_pose_that_cannot_be_is_named_with_its_file(tmp_path, out):
    bent = standing(G1).joint_pos.copy()
    bent[list(G1.joint_names).index("left_knee")] = 3.1
    stand = standing(G1)
    write_mjcf_keys(tmp_path / "k.xml", G1, [stand.at(0.5), replace(stand.at(1.0), joint_pos=bent, name="squat")])
    with pytest.raises(KeyframeError, match=r"k.xml': pose 2 .'squat'.: joint_pos: 'left_knee' is 3.1 rad"):
        keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "k.xml", out=tmp_path / out))
    assert not (tmp_path / out).exists()


def test_a_motion_is_not_replaced_by_keyframes(tmp_path):
    with pytest.raises(OutputError, match=r"own.npz': expected a file that ends in .json"):
        keyframes.main(keyframes.FromMotion(motion="generated:val/bow@1", every=0.5, out=tmp_path / "own.npz"))


def test_the_file_that_is_read_is_not_replaced(tmp_path):
    file = tmp_path / "drawn.json"
    file.write_bytes(EXAMPLE.read_bytes())
    with pytest.raises(OutputError, match=r"--out: would replace .*drawn.json', which is read"):
        keyframes.main(keyframes.ConvertKeyframes(file=file, out=tmp_path / "." / "drawn.json", kimodo=True))
    assert file.read_bytes() == EXAMPLE.read_bytes()


def test_constraints_are_no_xml(tmp_path):
    with pytest.raises(KeyframeError, match=r"--kimodo --out .*k.xml: constraints are JSON, expected .* in .json"):
        keyframes.main(keyframes.ConvertKeyframes(file=EXAMPLE, out=tmp_path / "k.xml", kimodo=True))


@pytest.mark.parametrize("out", ["out.json", "out.xml"])
def test_poses_out_of_order_are_refused_before_they_are_written(tmp_path, out):
    stand = standing(G1)
    write_keyframes(tmp_path / "two.json", G1, stand, [stand.at(0.5), stand.at(0.5)])
    with pytest.raises(KeyframeError, match=r"two.json': pose 2 is at 0.5 s, expected later than .* at 0.5 s"):
        keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "two.json", out=tmp_path / out))
    assert not (tmp_path / out).exists()


@pytest.mark.parametrize(
    ("name", "message"),
    [("walk.npz", "plat keyframes from-motion"), ("keys.xml", "plat keyframes convert")],
)
def test_what_becomes_keyframes_is_said_to(tmp_path, name, message):
    (tmp_path / name).write_bytes(b"PK")
    with pytest.raises(KeyframeError, match=rf"{name}': not one, expected JSON; {message}"):
        KeyframeSequence.load(tmp_path / name, G1)


def test_keys_in_a_file_that_is_called_mjcf(tmp_path):
    write_mjcf_keys(tmp_path / "k.mjcf", G1, [standing(G1).at(0.0), standing(G1).at(0.5)])
    poses = keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "k.mjcf", out=tmp_path / "out.json"))
    assert [pose.time for pose in poses] == [0.0, 0.5]


def test_what_cannot_be_converted_is_not_called_constraints(tmp_path):
    (tmp_path / "walk.npz").write_bytes(b"PK")
    with pytest.raises(KeyframeError, match=r"walk.npz': not one, expected JSON; plat keyframes from-motion"):
        keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "walk.npz", out=tmp_path / "out.json"))


@pytest.mark.parametrize("command", ["show", "convert", "convert constraints"])
def test_files_are_read_once(tmp_path, monkeypatch, command):
    """A file that changes between two readings would be checked in one form and used in another."""
    source = tmp_path / "source.json"
    kimodo = command == "convert constraints"
    keyframes.main(keyframes.ConvertKeyframes(file=EXAMPLE, out=source, kimodo=kimodo))
    read, real = [], Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read.append(path.name) or real(path))
    if command == "show":
        keyframes.main(keyframes.Show(file=source, split=True))
    else:
        keyframes.main(keyframes.ConvertKeyframes(file=source, out=tmp_path / "out.json"))
    assert read.count("source.json") == 1


def test_constraints_in_place_of_keyframes_are_said_to_be_converted(tmp_path):
    keyframes.main(keyframes.ConvertKeyframes(file=EXAMPLE, out=tmp_path / "constraints.json", kimodo=True))
    with pytest.raises(
        KeyframeError, match="not a keyframe file, .*; plat keyframes convert makes keyframes of constr"
    ):
        KeyframeSequence.load(tmp_path / "constraints.json", G1)
    (tmp_path / "list.json").write_text("[]")
    with pytest.raises(KeyframeError, match="'format': 'plat-keyframes'$"):
        KeyframeSequence.load(tmp_path / "list.json", G1)


def test_options_without_effect_are_refused(tmp_path):
    def convert(file, **options):
        return keyframes.main(keyframes.ConvertKeyframes(file=file, out=tmp_path / "out.json", **options))

    with pytest.raises(PlatError, match="--fps: takes effect only with --kimodo or a file of constraints"):
        convert(EXAMPLE, fps=10.0)
    with pytest.raises(PlatError, match="--every: takes effect only with keys that have no times"):
        convert(EXAMPLE, every=5.0)
    keyframes.main(keyframes.ConvertKeyframes(file=EXAMPLE, out=tmp_path / "timed.xml"))
    with pytest.raises(PlatError, match="--every: takes effect only with keys that have no times"):
        convert(tmp_path / "timed.xml", every=5.0)
    convert(EXAMPLE, fps=10.0, kimodo=True)
    (tmp_path / "out.json").rename(tmp_path / "constraints.json")
    half = KeyframeSequence.load(EXAMPLE, G1).duration / 2
    assert convert(tmp_path / "constraints.json", fps=20.0)[-1].time == pytest.approx(half, abs=0.03)


def test_a_partial_keyframe_does_not_become_the_start(tmp_path):
    """Its commands would be gone: it is refused as by show."""
    drawn, out = tmp_path / "p.json", tmp_path / "out.json"
    hand = only(G1, 0.5, left_hand=(0.35, 0.2, 0.95))
    write_keyframes(drawn, G1, standing(G1), [hand, standing(G1).at(1.0)])
    content = json.loads(drawn.read_text())
    del content["start"]
    content["keyframes"][0]["time"] = 0
    drawn.write_text(json.dumps(content))
    for run in (
        lambda: keyframes.main(keyframes.Show(file=drawn)),
        lambda: keyframes.main(keyframes.ConvertKeyframes(file=drawn, out=out)),
    ):
        with pytest.raises(
            KeyframeError, match=r"p.json': keyframe 0: time is 0 s, expected at least 0.02 s after 0 s"
        ):
            run()
    assert not out.exists()


@pytest.mark.parametrize(("out", "kimodo"), [("out.xml", False), ("out.json", True)])
@pytest.mark.parametrize("start", [True, False])
def test_a_partial_keyframe_that_cannot_be_converted_is_named_as_in_its_file(tmp_path, out, kimodo, start):
    drawn = tmp_path / "p.json"
    write_keyframes(drawn, G1, standing(G1), [standing(G1).at(0.5), only(G1, 1.0, left_hand=(0.35, 0.2, 0.95))])
    if not start:
        content = json.loads(drawn.read_text())
        del content["start"]
        drawn.write_text(json.dumps(content))
    with pytest.raises(KeyframeError, match=r"p.json': keyframe 1 commands parts of a pose, expected a whole one"):
        keyframes.main(keyframes.ConvertKeyframes(file=drawn, out=tmp_path / out, kimodo=kimodo))
    assert not (tmp_path / out).exists()


def test_times_that_move_to_frames_are_told(tmp_path, capsys):
    def told(*times: float) -> bool:
        write_keyframes(tmp_path / "k.json", G1, standing(G1), [standing(G1).at(time) for time in times])
        keyframes.main(keyframes.ConvertKeyframes(file=tmp_path / "k.json", out=tmp_path / "out.json", kimodo=True))
        return "times moved to the nearest frames, 30 a second: by up to 0.017 s\n" in capsys.readouterr().out

    assert told(0.02, 0.75, 1.25)
    assert not told(0.1, 0.5)
