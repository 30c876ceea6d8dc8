from dataclasses import replace

import torch

from plat.envs import MotionTrackingEnv, ResetNoise, TrackingTaskConfig, make_tracking_env
from plat.envs.transforms import DomainRandomization, RandomizationRanges
from plat.envs.transforms.settings import ROBOT_RANGES
from plat.robots import G1

STILL = ResetNoise(*[0.0] * 9)
OFF = RandomizationRanges(
    foot_friction=None,
    torso_com=(0, 0, 0),
    encoder_bias=0,
    motor_gain=0,
    control_delay=0,
    push_lin_vel=(0, 0, 0),
    push_ang_vel=(0, 0, 0),
)


def test_draws_are_within_their_ranges(library):
    env = MotionTrackingEnv(library, 200)
    ranges = RandomizationRanges()
    DomainRandomization(env, ranges)._reset_env_preprocess(None)
    model, physics = env.physics.model, env.physics
    feet = [i for i in range(model.ngeom) if "_foot" in model.geom(i).name]
    friction = physics.model_field("geom_friction")[:, feet, 0]
    assert (friction >= 0.3).all()
    assert (friction <= 1.2).all()
    assert friction[:, 0].std() > 0.2
    assert (friction == friction[:, :1]).all()  # one floor under both feet
    gain = physics.model_field("actuator_gainprm")[:, :, 0] / G1.stiffness
    assert ((gain > 0.899) & (gain < 1.101)).all()
    torch.testing.assert_close(
        physics.model_field("actuator_biasprm")[:, :, 1], -physics.model_field("actuator_gainprm")[:, :, 0]
    )
    torso = model.body("torso_link").id
    shift = physics.model_field("body_ipos")[:, torso] - torch.from_numpy(model.body_ipos[torso])
    assert (shift.abs() <= torch.tensor([0.025, 0.05, 0.05]) + 1e-9).all()
    assert (env.encoder_bias.abs() <= 0.01 + 1e-9).all()
    assert 0.3 < env.delay.float().mean() < 0.7
    assert env.delay.max() == 1
    assert not env.gyro_bias.any()
    assert not env.velocity_bias.any()


def test_the_full_set_has_a_load_longer_delays_and_an_estimators_errors(library):
    env = MotionTrackingEnv(library, 300)
    DomainRandomization(env, ROBOT_RANGES)._reset_env_preprocess(None)
    model, torso = env.physics.model, env.physics.model.body("torso_link").id
    load = env.physics.model_field("body_mass")[:, torso] - model.body_mass[torso]
    assert 1.5 < load.abs().max() <= ROBOT_RANGES.torso_mass
    inertia = env.physics.model_field("body_inertia")[:, torso] / torch.from_numpy(model.body_inertia[torso])
    torch.testing.assert_close(inertia, (1 + load / model.body_mass[torso])[:, None].expand(-1, 3))
    assert (torch.bincount(env.delay, minlength=3) / 300 - 1 / 3).abs().max() < 0.1
    observed = env.reset()["robot"]
    true = env.physics.state()[1]
    torch.testing.assert_close(observed["root_ang_vel_b"] - true[:, 3:6], env.gyro_bias)
    assert 0.04 < env.gyro_bias.abs().max() <= ROBOT_RANGES.gyro_bias
    assert 0.08 < env.velocity_bias.abs().max() <= ROBOT_RANGES.velocity_bias
    nominal = MotionTrackingEnv(library, 1).reset()["robot"]
    assert nominal.keys() == observed.keys()


def test_draws_that_are_not_asked_for_leave_the_others_as_they_were(library):
    drawn = []
    for ranges in (RandomizationRanges(), RandomizationRanges(torso_mass=1, longer_delay=0.5, gyro_bias=0.1)):
        torch.manual_seed(0)
        env = MotionTrackingEnv(library, 20)
        DomainRandomization(env, ranges)._reset_env_preprocess(None)
        drawn.append((env.encoder_bias, env.delay > 0))
    assert all(torch.equal(*pair) for pair in zip(*drawn, strict=True))


def test_switched_off_changes_nothing(library):
    rollouts = []
    for randomize in (False, True):
        torch.manual_seed(0)
        env = make_tracking_env(
            library, 4, TrackingTaskConfig(reset_noise=STILL, randomization=OFF if randomize else None)
        )
        starts = next(t for t in env.transform if hasattr(t, "sample"))
        starts.sample = lambda count: torch.arange(count) * 10
        rollouts.append(env.rollout(30, lambda td: td.set("action", torch.zeros(4, 29)), break_when_any_done=False))
    torch.testing.assert_close(*(rollout["next", "robot", "joint_pos"] for rollout in rollouts))


def test_a_friction_of_equal_ends_is_set_and_none_is_the_robots(library):
    drawn = []
    for friction, own in (((0.5, 0.5), False), (None, True)):
        torch.manual_seed(0)
        env = MotionTrackingEnv(library, 5)
        ranges = RandomizationRanges(foot_friction=friction)
        DomainRandomization(env, ranges)._reset_env_preprocess(None)
        feet = [i for i in range(env.physics.model.ngeom) if "_foot" in env.physics.model.geom(i).name]
        soles = env.physics.model_field("geom_friction")[:, feet, 0]
        nominal = torch.from_numpy(env.physics.model.geom_friction[feet, 0]).expand_as(soles)
        torch.testing.assert_close(soles, nominal if own else torch.full_like(soles, 0.5))
        assert (nominal != 0.5).all()
        drawn.append(env.encoder_bias)
        assert ranges.scaled(0.5).foot_friction == (None if own else (0.75, 0.75))
    assert torch.equal(*drawn)


def test_every_half_width_of_0_leaves_the_robot_as_it_is(library):
    """Of one quantity at a time: the draw says nothing of it, and the others of it as much as before."""
    every = RandomizationRanges(
        longer_delay=0.5,
        torso_mass=1.0,
        gyro_bias=0.1,
        velocity_bias=0.1,
        position_drift=0.1,
        heading_drift=0.1,
        height_error=0.1,
    )
    fields = ("geom_friction", "body_ipos", "body_mass", "actuator_gainprm", "actuator_biasprm")
    kept = ("encoder_bias", "gyro_bias", "velocity_bias", "delay", "drift", "drift_rate")

    def changed(ranges) -> set[str]:
        env = MotionTrackingEnv(library, 20)
        DomainRandomization(env, ranges)._reset_env_preprocess(None)
        model, physics = env.physics.model, env.physics
        of_model = {name for name in fields if (physics.model_field(name) != torch.tensor(getattr(model, name))).any()}
        return of_model | {name for name in kept if getattr(env, name).any()}

    assert changed(every) == {*fields, *kept}
    for off, left in (
        ({"foot_friction": None}, {"geom_friction"}),
        ({"torso_com": (0, 0, 0)}, {"body_ipos"}),
        ({"torso_mass": 0.0}, {"body_mass"}),
        ({"motor_gain": 0.0}, {"actuator_gainprm", "actuator_biasprm"}),
        ({"encoder_bias": 0.0}, {"encoder_bias"}),
        ({"control_delay": 0.0}, {"delay"}),
        ({"gyro_bias": 0.0}, {"gyro_bias"}),
        ({"velocity_bias": 0.0}, {"velocity_bias"}),
        ({"height_error": 0.0}, {"drift"}),
        ({"position_drift": 0.0, "heading_drift": 0.0}, {"drift_rate"}),
    ):
        assert {*fields, *kept} - changed(replace(every, **off)) == left


def test_only_reset_robots_are_drawn_anew(library):
    env = make_tracking_env(library, 8, TrackingTaskConfig(randomization=RandomizationRanges()))
    state = env.reset()
    bias = env.base_env.encoder_bias.clone()
    mask = torch.zeros(8, 1, dtype=torch.bool)
    mask[3] = True
    env.reset(state.update({"_reset": mask}))
    changed = (env.base_env.encoder_bias != bias).any(-1)
    assert changed.tolist() == mask[:, 0].tolist()


def test_pushes_come_at_their_interval(library):
    env = MotionTrackingEnv(library, 100)
    randomization = DomainRandomization(env, RandomizationRanges(push_interval=(0.1, 0.2)))
    randomization._reset_env_preprocess(None)
    env.reset()
    pushes = torch.zeros(100)
    for _ in range(50):
        _, before = env.physics.state()
        randomization._inv_call(None)
        change = (env.physics.state()[1] - before)[:, :6].abs()
        assert (change <= torch.tensor([0.5, 0.5, 0.2, 0.52, 0.52, 0.78]) + 1e-5).all()
        pushes += change.sum(-1) > 0
    # a second has room for five to ten
    assert 5 <= pushes.mean() <= 10
