from types import SimpleNamespace

import numpy as np
import pytest

from plat.cli import sim_to_sim
from plat.control import Simulator
from plat.control.changed_physics import Delayed, PhysicsSetting
from plat.errors import KeyframeError
from plat.export import export_bundle
from plat.keyframes import standing
from plat.motions import MotionLibrary, generate_motions
from plat.robots import G1
from plat.spec.timing import Timing
from tests.deploy.robots import describe_g1
from tests.export.runs import small_policy, write_run


@pytest.fixture(scope="module")
def library() -> MotionLibrary:
    return MotionLibrary.from_clips(generate_motions("val", seconds=8)[:1])


def model(**physics):
    return sim_to_sim.make_model(G1, describe_g1(), PhysicsSetting("some", **physics))


def test_nothing_changes_unless_asked():
    ours, theirs = model(), G1.model()
    for field in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "geom_friction"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))
    assert ours.opt.timestep == theirs.opt.timestep


def test_gains_are_those_of_the_bundle_times_a_factor():
    ours, theirs = model(gain=0.9), G1.model()
    np.testing.assert_allclose(ours.actuator_gainprm[:, 0], 0.9 * theirs.actuator_gainprm[:, 0])
    np.testing.assert_allclose(ours.actuator_biasprm[:, 1:3], 0.9 * theirs.actuator_biasprm[:, 1:3])


@pytest.mark.parametrize("feet", ["spheres", "capsules"])
def test_friction_is_of_the_soles_alone(feet):
    ours, theirs = model(feet=feet, friction=0.3), G1.model(feet)
    changed = np.flatnonzero((ours.geom_friction != theirs.geom_friction).any(1))
    assert {ours.body(ours.geom_bodyid[geom]).name for geom in changed} == set(G1.feet)
    soles = [geom for geom in changed if ours.geom_contype[geom] or ours.geom_conaffinity[geom]]
    assert len(soles) == (8 if feet == "spheres" else 14)
    np.testing.assert_array_equal(ours.geom_friction[soles, 0], 0.3)


def test_targets_come_late():
    class Counter:
        timing = Timing()

        def reset(self, joint_target=None):
            self.count = 0

        def __call__(self, state, keyframe, steps_left):
            self.count += 1
            return np.full(29, float(self.count))

    robot, pose = describe_g1(), standing(G1)
    for delay in (0, 1, 2):
        delayed = Delayed(Counter(), robot, delay)
        late = [delayed(None, pose, 1)[0] for _ in range(4)]
        assert late == [*[robot.default_joint_pos[0]] * delay, 1.0, 2.0, 3.0, 4.0][:4]
    delayed.reset(np.full(29, 7.0))
    assert [delayed(None, pose, 1)[0] for _ in range(3)] == [7.0, 7.0, 1.0]


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
    scores = sim_to_sim.run(Track(), sequence, Simulator(model(timestep=0.001)))
    assert [score.reached for score in scores] == [True, True]


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
    assert lines[0] == "1 sequences, 2 keyframes, 0 s"
    assert [len(scores) for scores in results.values()] == [2] * len(sim_to_sim.SETTINGS)
    for physics, line in zip(sim_to_sim.SETTINGS, lines[2:], strict=False):
        share = 100 * np.mean([score.reached for score in results[physics.name]])
        assert line.startswith(physics.name)
        assert f"{share:.1f}" in line


def test_nothing_to_run(tmp_path, monkeypatch):
    monkeypatch.setattr(sim_to_sim, "PolicyRunner", lambda *_: SimpleNamespace(timing=Timing()))
    with pytest.raises(KeyframeError, match="nothing to run: give --motions or --keyframes"):
        sim_to_sim.main(sim_to_sim.SimToSimRecipe(bundle=tmp_path, motions=()))
