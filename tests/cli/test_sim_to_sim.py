import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from plat.cli import sim_to_sim
from plat.control import Simulator
from plat.errors import ActionError, BundleError, KeyframeError, PlatError
from plat.export import export_bundle
from plat.keyframes import KeyframeSequence, only, standing
from plat.motions import MotionLibrary, generate_motions
from plat.robots import G1
from plat.robots.describe import describe_robot
from plat.spec.timing import Timing
from tests.control.made_up import score
from tests.control.test_changed_physics import model
from tests.export.runs import small_policy, write_run


@pytest.fixture(scope="module")
def library() -> MotionLibrary:
    return MotionLibrary.from_clips(generate_motions("val", seconds=8)[:1])


def test_keyframes_are_the_commands_of_the_evaluation(library):
    (sequence,) = sim_to_sim.motion_keyframes(library, 0, Timing())
    arrivals = [0, *sequence.arrival_steps]
    lengths = np.diff(arrivals)
    assert arrivals[-1] == len(library) - 1
    assert ((lengths >= 1) & (lengths <= 50)).all()
    for step, keyframe in zip(arrivals[1:], sequence.keyframes, strict=True):
        np.testing.assert_allclose(keyframe.joint_pos, library.frames["joint_pos"][step], atol=1e-6)


def test_a_controller_that_holds_the_reference_reaches_keyframes(library):
    class Track:
        timing = Timing()

        def reset(self, joint_target=None):
            pass

        def __call__(self, state, keyframe, steps_left):
            return np.asarray(keyframe.joint_pos)

    pose = standing(G1)
    sequence = sim_to_sim.KeyframeSequence(G1, pose, (pose.at(0.2), pose.at(0.4)))
    scores, ended = sim_to_sim.run(Track(), sequence, Simulator(model(timestep=0.001)))
    assert not ended
    assert [score.success for score in scores] == [True, True]


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        ({"seed": 3, "motions": (), "keyframes": (Path("wave.json"),)}, "--seed: takes effect only with --motions"),
        ({"split": True}, "--split: takes effect only with --keyframes"),
    ],
)
def test_flags_without_effect_are_refused(tmp_path, flags, told):
    with pytest.raises(PlatError, match=told):
        sim_to_sim.main(sim_to_sim.SimToSimRecipe(bundle=tmp_path / "bundle", **flags))


def test_a_file_of_partial_keyframes_for_a_policy_of_whole_ones_is_named_first(tmp_path, monkeypatch):
    runner = SimpleNamespace(timing=Timing(), robot=describe_robot(G1, 0.02), sees_parts=False)
    monkeypatch.setattr(sim_to_sim, "PolicyRunner", lambda *_: runner)
    KeyframeSequence(G1, standing(G1), (standing(G1).at(0.5),)).save(tmp_path / "whole.json")
    KeyframeSequence(G1, standing(G1), (only(G1, 0.5, height=0.7),)).save(tmp_path / "low.json")
    files = (tmp_path / "whole.json", tmp_path / "low.json")
    recipe = sim_to_sim.SimToSimRecipe(bundle=tmp_path, motions=(), keyframes=files)
    with pytest.raises(KeyframeError, match=r"^keyframe file '.*low.json': the keyframe at 0.5 s commands a part of"):
        sim_to_sim.main(recipe)


def test_a_start_in_the_floor_is_named_with_its_file(tmp_path, monkeypatch):
    runner = SimpleNamespace(timing=Timing(), robot=describe_robot(G1, 0.02), sees_parts=False)
    monkeypatch.setattr(sim_to_sim, "PolicyRunner", lambda *_: runner)
    stand = standing(G1)
    low = replace(stand, root_pos=stand.root_pos - [0, 0, 0.56])
    KeyframeSequence(G1, low, (stand.at(0.5),)).save(tmp_path / "low.json")
    recipe = sim_to_sim.SimToSimRecipe(bundle=tmp_path, motions=(), keyframes=(tmp_path / "low.json",))
    with pytest.raises(KeyframeError, match=r"^keyframe file '.*low.json': start: the robot is 56 cm inside the floor"):
        sim_to_sim.main(recipe)


def test_a_bundle_of_another_robot_with_the_same_joints_is_refused(tmp_path, monkeypatch):
    bent = replace(G1, name="bent", default_pose={**G1.default_pose, "left_elbow": 1.2})
    runner = SimpleNamespace(timing=Timing(), robot=describe_robot(bent, 0.02))
    monkeypatch.setattr(sim_to_sim, "PolicyRunner", lambda *_: runner)
    with pytest.raises(BundleError, match=r"^bundle '.*': drives robot 'bent', expected 'g1', that of --robot$"):
        sim_to_sim.main(sim_to_sim.SimToSimRecipe(bundle=tmp_path))


def test_the_table(tmp_path, capsys):
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    export_bundle(write_run(tmp_path / "run", small_policy("latent")), tmp_path / "bundle")
    pose = standing(G1)
    sequence = sim_to_sim.KeyframeSequence(G1, pose, (pose.at(0.1), pose.at(0.2)))
    sequence.save(tmp_path / "stand.json")
    recipe = sim_to_sim.SimToSimRecipe(bundle=tmp_path / "bundle", motions=(), keyframes=(tmp_path / "stand.json",))
    results = sim_to_sim.main(recipe)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "1 sequence, 2 keyframes, 0 s"
    assert lines[1].split() == ["TKS@3", "%", "falls", "%", "MPJPE@3", "rad", "MPKPE@3", "mm"]
    settings = sim_to_sim.physics_settings(0.02)
    assert [len(scores) for scores in results.values()] == [2] * len(settings)
    for physics, line in zip(settings, lines[2:], strict=False):
        share = 100 * np.mean([score.success for score in results[physics.name]])
        assert line.startswith(physics.name)
        assert f"{share:.1f}" in line


def test_long_intervals_are_split_where_that_is_asked_for(tmp_path, monkeypatch, capsys):
    runner = SimpleNamespace(timing=Timing(), robot=describe_robot(G1, 0.02), reset=lambda *_: None)
    monkeypatch.setattr(sim_to_sim, "PolicyRunner", lambda *_: runner)
    monkeypatch.setattr(
        sim_to_sim, "run", lambda _, sequence, *__: ([score(n, None, 0.1) for n in range(len(sequence))], "")
    )
    pose, file = standing(G1), tmp_path / "slow.json"
    KeyframeSequence(G1, pose, (pose.at(2.0),), Timing(max_steps=100)).save(file)
    recipe = sim_to_sim.SimToSimRecipe(bundle=tmp_path, motions=(), keyframes=(file,))
    with pytest.raises(KeyframeError, match="slow.json': keyframe 0: time is 2 s, .*--split of plat play, plat sim-to"):
        sim_to_sim.main(recipe)
    results = sim_to_sim.main(replace(recipe, split=True))
    assert {len(scores) for scores in results.values()} == {2}
    assert "slow.json: keyframe 0 comes 2 s after the one before" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("target", "told"),
    [
        (1e12, "the simulation diverged 0.10 s after its start: targets or pushes are too large"),
        (math.nan, "the target of joint 'left_hip_pitch_joint' is nan, expected a finite angle"),
    ],
)
def test_a_sequence_that_ends_early_costs_its_own_keyframes_alone(tmp_path, monkeypatch, capsys, target, told):
    """The robot of the sequence that leans gets a bad target for its second keyframe."""

    class Runner:
        timing, robot = Timing(), describe_robot(G1, 0.02)

        def reset(self, joint_target=None):
            pass

        def __call__(self, state, keyframe, steps_left):
            return np.full(29, target) if keyframe.name == "bad" else np.asarray(keyframe.joint_pos)

    monkeypatch.setattr(sim_to_sim, "PolicyRunner", lambda *_: Runner())
    settings = sim_to_sim.physics_settings(0.02)[:2]
    monkeypatch.setattr(sim_to_sim, "physics_settings", lambda control_dt: settings)
    pose = standing(G1)
    files = tmp_path / "bad.json", tmp_path / "good.json"
    for file, name in zip(files, ("bad", "good"), strict=True):
        frames = (pose.at(0.1), replace(pose.at(0.2), name=name), pose.at(0.3))
        KeyframeSequence(G1, pose, frames).save(file)
    with pytest.raises(
        ActionError, match="^2 of 4 runs ended early, because the simulation diverged or a target was not"
    ):
        sim_to_sim.main(sim_to_sim.SimToSimRecipe(bundle=tmp_path, motions=(), keyframes=files))
    lines = capsys.readouterr().out.splitlines()
    for row, line in (lines[2:4], lines[4:6]):
        assert row.split()[-4:-2] == ["66.7", "33.3"]
        assert line == f"  {str(files[0])!r} at 0.10 s: {told}; it fell from there on"
    assert lines[2].startswith("as in training")
    assert lines[4].startswith("1 ms physics steps")


def test_nothing_to_run(tmp_path, monkeypatch):
    runner = SimpleNamespace(timing=Timing(), robot=describe_robot(G1, 0.02))
    monkeypatch.setattr(sim_to_sim, "PolicyRunner", lambda *_: runner)
    with pytest.raises(KeyframeError, match="nothing to run: give --motions or --keyframes"):
        sim_to_sim.main(sim_to_sim.SimToSimRecipe(bundle=tmp_path, motions=()))


def test_errors_are_means_over_what_is_commanded(tmp_path, capsys, monkeypatch):
    """One of two keyframes commands no joint: it has no joint error."""
    rows = [score(0, None, 0.1, joint=0.01, keypoint=0.02), score(1, None, 0.2, joint=math.nan, keypoint=0.04)]
    runner = SimpleNamespace(timing=Timing(), robot=describe_robot(G1, 0.02), reset=lambda *_: None)
    monkeypatch.setattr(sim_to_sim, "PolicyRunner", lambda *_: runner)
    monkeypatch.setattr(sim_to_sim, "run", lambda *_: (rows, ""))
    KeyframeSequence(G1, standing(G1), (standing(G1).at(0.1),)).save(tmp_path / "stand.json")
    sim_to_sim.main(sim_to_sim.SimToSimRecipe(bundle=tmp_path, motions=(), keyframes=(tmp_path / "stand.json",)))
    assert capsys.readouterr().out.splitlines()[2].split()[-2:] == ["0.010", "30"]
