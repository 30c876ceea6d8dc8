import numpy as np
import pytest

from plat.control import Chase, Simulator
from plat.control.changed_physics import Delayed, PhysicsSetting, make_model, physics_settings
from plat.errors import KeyframeError
from plat.keyframes import KeyframeSequence, only, standing
from plat.robots import G1, describe_robot
from plat.spec.timing import Timing
from tests.control.puppets import Puppet
from tests.deploy.robots import describe_g1


def model(**physics):
    return make_model(G1, describe_g1(), PhysicsSetting("some", **physics))


def test_nothing_changes_unless_asked():
    ours, theirs = model(), G1.model()
    for field in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "geom_friction"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))
    assert ours.opt.timestep == theirs.opt.timestep


@pytest.mark.parametrize("dt", [0.02, 0.01, 1 / 60])
def test_settings_are_those_of_the_control_step(dt):
    settings = {physics.name: physics for physics in physics_settings(dt)}
    (late,) = (physics for name, physics in settings.items() if name.endswith("ms control delay"))
    assert late.delay == 1
    assert float(late.name.split()[0]) == pytest.approx(1000 * dt, rel=1e-2)
    robot = describe_robot(G1, dt)
    for physics in settings.values():
        Simulator(make_model(G1, robot, physics), dt)  # a whole number of physics steps
    assert make_model(G1, robot, settings["as in training"]).opt.timestep == pytest.approx(dt / 4)
    steps = [float(name.split()[0]) for name in settings if name.endswith("physics steps")]
    assert steps == pytest.approx([1.0], abs=0.05)


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


def test_a_delayed_policy_for_whole_poses_is_still_one():
    class Whole(Puppet):
        sees_parts = False

    sequence = KeyframeSequence(G1, standing(G1), (only(G1, 0.1, height=0.7),))
    Chase(Delayed(Puppet(), describe_g1(), 1), sequence, Simulator(G1.model()))
    with pytest.raises(KeyframeError, match="trained on whole poses"):
        Chase(Delayed(Whole(), describe_g1(), 1), sequence, Simulator(G1.model()))
