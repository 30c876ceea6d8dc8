import csv
import dataclasses
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from plat.cli import play
from plat.control import ReachLimits
from plat.control.authored import author
from plat.errors import ActionError, CheckpointError, KeyframeError, OutputError, PlatError
from plat.keyframes import KeyframeSequence, only, standing
from plat.modules import PlainPolicy, PlainPolicyConfig
from plat.rendering import RenderingError, Stage
from plat.robots import G1
from plat.spec.parts import Parts
from plat.spec.timing import Timing
from tests.export.runs import write_run

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "recipes" / "examples" / "bow.json"
PLAT = ROOT / "plat" / "weights" / "plat"


@pytest.mark.parametrize("policy", ["plat", "dagger", "expert", "imagined"])
def test_the_committed_policies_reach_every_keyframe_of_the_example(policy, capsys):
    scores = play.main(play.PlayRecipe(policy=ROOT / "plat" / "weights" / policy, keyframes=EXAMPLE))
    assert [score.reached for score in scores] == [True] * 5
    assert all(score.keypoint_error < 0.25 for score in scores)
    lines = capsys.readouterr().out.splitlines()
    assert re.match(r"  1  bow +1.42  yes +0\.\d{3} +\d{1,3}  reached$", lines[2])
    figures = r"MPJPE@3 0\.\d{3} rad, MPKPE@3 \d{1,3} mm"
    assert re.match(f"5 of 5 reached; TKS@3 5 of 5, these with {figures}$", lines[-2])
    assert lines[-1] == "held for 3.0 s"


def test_hands_alone_are_led_along_a_circle(capsys):
    recipe = play.PlayRecipe(policy=ROOT / "plat" / "weights" / "imagined", keyframes=EXAMPLE.with_name("hands.json"))
    scores = play.main(recipe)
    assert [score.outcome for score in scores] == ["reached"] * 9
    assert all(score.keypoint_error < 0.12 for score in scores)
    with pytest.raises(
        KeyframeError, match=r"^keyframe file '.*hands.json': the keyframe at 1 s .* commands a part of"
    ):
        play.main(dataclasses.replace(recipe, policy=PLAT))


def test_standing_up_from_where_the_hands_led_is_no_fall(tmp_path):
    chains = [chain.sequence.keyframes for chain in author("crouch", G1, 6, seed=0)]
    low = min((keyframe for keyframes in chains for keyframe in keyframes), key=lambda keyframe: keyframe.root_pos[2])
    hands = Parts.only(G1, bodies=("left_wrist_yaw_link", "right_wrist_yaw_link"))
    pose, low = standing(G1), dataclasses.replace(low.at(1.5), commands=hands)
    KeyframeSequence(G1, pose, (low, pose.at(2.5)), Timing(max_steps=150)).save(tmp_path / "low.json")
    recipe = play.PlayRecipe(policy=ROOT / "plat" / "weights" / "imagined", keyframes=tmp_path / "low.json")
    assert [(score.words, score.success) for score in play.main(recipe)] == [("reached", True)] * 2


def test_shoves_are_felt_and_a_seed_repeats_them(capsys):
    recipe = play.PlayRecipe(policy=PLAT, keyframes=EXAMPLE, push=0.4, push_every=1.0, hold=0.0)
    calm = play.main(dataclasses.replace(recipe, push=0.0, push_every=1.5))
    assert "shove" not in capsys.readouterr().out
    first, again, other = (play.main(dataclasses.replace(recipe, seed=seed)) for seed in (1, 1, 2))
    assert first == again
    assert first != other
    assert first != calm
    assert first[0] == calm[0]  # it arrives before the first shove
    shoves = re.findall(r"shove of 0.4 m/s at (\d\.\d\d) s", capsys.readouterr().out)
    assert shoves == ["1.00", "2.00", "3.00"] * 3


def test_a_keyframe_that_is_out_of_reach_is_said_to_be_missed(tmp_path, capsys):
    pose = standing(G1)
    up = dataclasses.replace(pose, root_pos=pose.root_pos + np.array([0.0, 0.0, 0.4]), name="fly")
    KeyframeSequence(G1, pose, (up.at(0.4),)).save(tmp_path / "fly.json")
    (score,) = play.main(play.PlayRecipe(policy=PLAT, keyframes=tmp_path / "fly.json", hold=0.0))
    assert not score.reached
    row, total = capsys.readouterr().out.splitlines()[-2:]
    assert re.search(r"  no .* late or off: 0\.\d\d m off", row)
    assert total == "0 of 1 reached, 1 late or off; TKS@3 0 of 1"


def test_what_was_done_before_the_simulation_diverges_is_written(tmp_path, capsys, monkeypatch):
    filmed = []
    monkeypatch.setattr(play, "Stage", lambda robot: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(play, "film_with_progress", lambda stage, playbacks: playbacks)
    monkeypatch.setattr(play, "write_video", lambda path, playbacks: filmed.extend(playbacks))
    recipe = play.PlayRecipe(policy=PLAT, keyframes=EXAMPLE, push=1e12, push_every=2.0)
    with pytest.raises(
        ActionError, match=r"bow.json' at 2.00 s: the simulation diverged 2.00 s after .*; it fell from"
    ):
        play.main(dataclasses.replace(recipe, csv=tmp_path / "scores.csv", video=tmp_path / "film.mp4"))
    lines = capsys.readouterr().out.splitlines()
    assert re.match(r"  2  stay +2.12  no +- +-  fell$", lines[-6])
    assert lines[-3].startswith("2 of 5 reached, 3 fell; TKS@3 2 of 5, these with MPJPE@3 0.0")
    assert lines[-2:] == [f"wrote {tmp_path / 'scores.csv'}", f"wrote {tmp_path / 'film.mp4'}"]
    rows = list(csv.DictReader((tmp_path / "scores.csv").read_text().splitlines()))
    assert [row["outcome"] for row in rows] == ["reached"] * 2 + ["fell"] * 3
    assert [bool(row["root_m"]) for row in rows] == [True] * 2 + [False] * 3
    assert [len(playback.qpos) for playback in filmed] == [100]


def test_a_policy_without_a_finite_action_at_the_start(tmp_path, capsys, monkeypatch):
    """There is nothing to film."""
    broken = PlainPolicy(G1)
    for weights in broken.parameters():
        weights.data.fill_(math.nan)
    monkeypatch.setattr(play, "load_policy", lambda _: broken)
    monkeypatch.setattr(play, "Stage", lambda robot: SimpleNamespace(close=lambda: None))
    with pytest.raises(ActionError, match=r"bow.json' at 0.00 s: the policy's action for joint .* is nan, expected"):
        play.main(play.PlayRecipe(policy=PLAT, keyframes=EXAMPLE, video=tmp_path / "film.mp4"))
    assert "0 of 5 reached, 5 fell; TKS@3 0 of 5" in capsys.readouterr().out


def test_a_file_that_cannot_be_written_is_named_before_the_robot_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(play, "Chase", lambda *_, **__: pytest.fail("ran first"))
    with pytest.raises(OutputError, match=r"--csv .*: is a folder, expected a file"):
        play.main(play.PlayRecipe(policy=PLAT, keyframes=EXAMPLE, csv=tmp_path))


def test_outcomes_go_to_a_file(tmp_path):
    path = tmp_path / "new" / "scores.csv"
    scores = play.main(play.PlayRecipe(policy=PLAT, keyframes=EXAMPLE, hold=0.0, csv=path))
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert [(row["name"], row["outcome"], row["late_s"]) for row in rows] == [
        (score.name, "reached", "") for score in scores
    ]
    assert [float(row["root_m"]) for row in rows] == pytest.approx([score.arrival.root for score in scores], abs=1e-4)


def test_figures_are_named_by_the_arrival_window_of_the_policy(tmp_path, capsys):
    run = write_run(tmp_path / "run", PlainPolicy(G1, PlainPolicyConfig(timing=Timing(window=5))))
    play.main(play.PlayRecipe(policy=run, keyframes=EXAMPLE, hold=0.0, csv=tmp_path / "scores.csv"))
    out = capsys.readouterr().out
    assert "TKS@5  MPJPE@5 rad  MPKPE@5 mm" in out
    assert re.search(r"; TKS@5 \d of 5", out)
    assert "@3" not in out
    assert (tmp_path / "scores.csv").read_text().splitlines()[0].endswith(",tks5,mpjpe5_rad,mpkpe5_m")


def test_a_policy_of_another_control_step_is_played(tmp_path, capsys):
    """At 60 Hz: no whole number of the description's physics steps."""
    timing = Timing(control_dt=1 / 60)
    run = write_run(tmp_path / "run", PlainPolicy(G1, PlainPolicyConfig(timing=timing)))
    KeyframeSequence(G1, standing(G1), (standing(G1).at(0.1),), timing).save(tmp_path / "stand.json")
    play.main(play.PlayRecipe(policy=run, keyframes=tmp_path / "stand.json", hold=0.0))
    assert "of 1 reached" in capsys.readouterr().out


def test_what_a_partial_keyframe_does_not_command_is_empty_in_the_file(tmp_path):
    hands = only(G1, 0.5, left_hand=(0.3, 0.2, 1.0))
    away = only(G1, 1.0, root=(0.1, 0.0), heading=0.3)
    elbow = only(G1, 1.5, joints={"left_elbow": 1.0})
    KeyframeSequence(G1, standing(G1), (hands, away, elbow, standing(G1).at(2.0))).save(tmp_path / "parts.json")
    recipe = play.PlayRecipe(policy=ROOT / "plat" / "weights" / "imagined", keyframes=tmp_path / "parts.json", hold=0.0)
    play.main(dataclasses.replace(recipe, csv=tmp_path / "scores.csv"))
    rows = list(csv.DictReader((tmp_path / "scores.csv").read_text().splitlines()))
    names = ("root_m", "joints_rad", "bodies_m", "turn_rad", "mpjpe3_rad", "mpkpe3_m")
    assert [[name for name in names if row[name]] for row in rows] == [
        ["bodies_m", "mpkpe3_m"],
        ["root_m", "turn_rad"],
        ["joints_rad", "mpjpe3_rad"],
        list(names),
    ]
    assert all(float(row[name]) > 0 for row in rows for name in names if row[name])


def test_a_tolerance_can_be_chosen_and_it_decides_who_has_reached():
    recipe = play.PlayRecipe(policy=PLAT, keyframes=EXAMPLE, hold=0.0)
    strict = play.main(dataclasses.replace(recipe, reach=ReachLimits(joints=1e-3)))
    assert [score.outcome for score in strict] == ["late or off"] * 5
    assert all(score.success for score in strict)  # TKS@3 stays what it is
    assert re.match(r"(\d\.\d\d s late, )?joints 0\.\d\d rad off$", ", ".join(strict[0].faults))


def test_a_video_is_written(tmp_path):
    try:
        Stage(G1, width=64, height=64).close()
    except RenderingError as error:
        pytest.skip(str(error))
    imageio = pytest.importorskip("imageio.v2")
    KeyframeSequence(G1, standing(G1), (standing(G1).at(0.2),)).save(tmp_path / "stand.json")
    video = tmp_path / "new" / "film.mp4"
    play.main(play.PlayRecipe(policy=PLAT, keyframes=tmp_path / "stand.json", hold=0.12, video=video))
    pictures = imageio.mimread(video)
    assert len(pictures) == 8
    assert pictures[0].shape == (480, 640, 3)
    # the bar is full of green at the beginning and empty in the hold
    bar = [picture[-8, 320].astype(int) for picture in (pictures[0], pictures[-1])]
    assert bar[0][1] > bar[0][0] + 50
    assert abs(bar[1][1] - bar[1][0]) < 30


def test_long_intervals_are_split_where_that_is_asked_for_and_the_rule_is_told(tmp_path, capsys):
    content = EXAMPLE.read_text().replace('"time": 3.54', '"time": 5.0')
    (tmp_path / "slow.json").write_text(content)
    recipe = play.PlayRecipe(policy=PLAT, keyframes=tmp_path / "slow.json", hold=0.0)
    with pytest.raises(KeyframeError, match=r"slow.json': keyframe 4 \('stand'\): time is 5 s, 108 control steps"):
        play.main(recipe)
    scores = play.main(dataclasses.replace(recipe, split=True))
    assert capsys.readouterr().out.startswith(
        "keyframe 4 ('stand') comes 2.16 s after the one before, the policy's longest command is 1 s: "
        "split into 3 equal parts, at poses on the straight line between the two\n"
    )
    assert [score.name for score in scores[-3:]] == ["stand 1/3", "stand 2/3", "stand"]


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"policy": Path("nowhere")}, CheckpointError, "'nowhere': no such run directory"),
        ({"keyframes": Path("nowhere.json")}, KeyframeError, "nowhere.json': no such file"),
        ({"hold": math.inf}, KeyframeError, "hold is inf s, expected at most 3600 without --viewer"),
        ({"video": Path("film.avi")}, RenderingError, "film.avi': expected a file name that ends in .mp4"),
    ],
)
def test_what_is_wrong_shows_before_the_robot_runs(changes, error, message, monkeypatch):
    monkeypatch.setattr(play, "Chase", None)
    recipe = dataclasses.replace(play.PlayRecipe(policy=PLAT, keyframes=EXAMPLE), **changes)
    with pytest.raises(error, match=message):
        play.main(recipe)


def test_a_start_in_the_floor_is_named_with_its_file(tmp_path):
    stand = standing(G1)
    low = dataclasses.replace(stand, root_pos=stand.root_pos - [0, 0, 0.56])
    KeyframeSequence(G1, low, (stand.at(0.5),)).save(tmp_path / "low.json")
    with pytest.raises(KeyframeError, match=r"^keyframe file '.*low.json': start: the robot is 56 cm inside the floor"):
        play.main(play.PlayRecipe(policy=PLAT, keyframes=tmp_path / "low.json"))


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a display")
def test_the_viewer_without_a_display_is_one_line():
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    arguments = ["--policy", str(PLAT), "--keyframes", str(EXAMPLE), "--viewer"]
    command = [sys.executable, "-m", "plat", "play", *arguments]
    out = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, env=environment)
    assert out.returncode == 1
    assert out.stderr.strip().splitlines()[-1].startswith("error: no window for the viewer")
    assert "Traceback" not in out.stderr


@pytest.mark.parametrize(("flag", "settings"), [("--push-every", {"push_every": 1.0}), ("--seed", {"seed": 3})])
def test_shoves_of_no_speed_are_refused(flag, settings):
    with pytest.raises(PlatError, match=f"{flag}: takes effect only with --push"):
        play.main(play.PlayRecipe(policy=PLAT, keyframes=EXAMPLE, **settings))
