"""A second robot, with a description, names and an asset of its own, goes the whole way."""

from dataclasses import replace
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest
import torch

from plat.cli import main
from plat.collectors import rollouts
from plat.control import Chase, PolicyController, Simulator
from plat.control.authored import author
from plat.deploy import PolicyRunner
from plat.envs import BatchedPhysics, KeyframeTaskConfig, TrackingTaskConfig, make_keyframe_env, make_tracking_env
from plat.envs.randomized_physics import RandomizedPhysics
from plat.envs.transforms import HORIZONS, NoiseLevels, RandomizationRanges
from plat.envs.transforms.settings import ROBOT_RANGES
from plat.errors import CheckpointError, KeyframeError, RobotError, TaskError
from plat.evaluation import evaluate, report
from plat.evaluation.authored_scores import author_families
from plat.evaluation.cells import Candidate
from plat.evaluation.entrant import Entrant
from plat.evaluation.study import StudyPlan, run_study
from plat.keyframes import KeyframeSequence, standing
from plat.modules import Critic, Expert, ExpertConfig, LatentPolicy
from plat.motions import MotionClip, MotionLibrary, load_motions, mirror_motion, save_csv, save_motions
from plat.motions.retargeting.geometry import RobotGeometry
from plat.objectives import PPO, PPOConfig, motor_gradient
from plat.recipes import expert_model, learning
from plat.robots import G1, ForwardKinematics, Robot, get_robot, registry
from plat.robots.center_of_mass import link_names
from plat.runs import Budget, Run, load_policy
from plat.spec.observation import observation_size, student_keys
from plat.tasks import draw_chains
from tests.export.runs import write_run
from tests.modules.policies.test_student import SMALL

DESCRIPTION = Path(__file__).parent / "toy.json"
SIMULATION = {"noise": NoiseLevels(), "randomization": RandomizationRanges()}


@pytest.fixture
def toy() -> Robot:
    return get_robot(DESCRIPTION)


def squats(robot: Robot, frames: int = 90) -> MotionClip:
    """Knees that bend and stretch on the spot."""
    qpos = np.tile(robot.default_qpos, (frames, 1))
    bend = 0.15 * (1 - np.cos(np.arange(frames) / 10))
    for joint, factor in (("hip", -1), ("knee", 2), ("ankle", -1)):
        for side in "lr":
            qpos[:, 7 + robot.joint_names.index(f"{joint}_{side}")] += factor * bend
    return MotionClip("squats", qpos, 30.0)


@pytest.fixture
def motions(toy) -> MotionLibrary:
    return MotionLibrary.from_clips([squats(toy)], toy)


def test_its_names_are_its_own(toy):
    assert toy.joint_names == ("waist", "hip_l", "knee_l", "ankle_l", "hip_r", "knee_r", "ankle_r")
    assert [toy.depth(joint) for joint in toy.joint_names] == [1, 1, 2, 3, 1, 2, 3]
    assert toy.leg_joints == [1, 2, 3, 4, 5, 6]
    assert toy.sole_geoms(toy.model()).shape == (2, 1)
    assert ForwardKinematics(toy)(torch.zeros(3), torch.tensor([1.0, 0, 0, 0]), torch.zeros(7))[0].shape == (6, 3)


def test_nothing_is_asked_of_hands_that_it_lacks(motions):
    assert set(draw_chains(motions, 4, ["steps", "reach"]).family) == {"steps"}
    with pytest.raises(TaskError, match="hands that come ahead of the robot, or legs"):
        draw_chains(motions, 4, ["reach", "three_point"])
    families = {chain.family for chain in author_families(motions.robot, motions, 1)}
    assert families == {"hold", "arms", "poses", "steps", "waypoint", "far"}
    with pytest.raises(KeyframeError, match="'reach' needs hands"):
        author("reach", motions.robot, 1, seed=0)
    with pytest.raises(KeyframeError, match="'crouch' needs legs of six joints"):
        author("crouch", motions.robot, 1, seed=0)


def test_it_learns_without_the_report_on_motions_of_the_g1(motions, tmp_path, capsys):
    recipe = expert_model.ExpertModelRecipe(motions=("x.npz",), robot=str(DESCRIPTION), out=tmp_path, steps=1)
    assert learning.unseen_motions(recipe, motions) is None
    assert "not reported, generated:val@120 is for the G1 (--unseen names other motions)" in capsys.readouterr().out
    assert expert_model.after(recipe).endswith(f"--robot {DESCRIPTION}")


def test_chains_that_go_lower_are_left_out(motions):
    families = set(draw_chains(motions, 20).family)
    assert "arms" in families
    assert not families & {"crouch", "three_point"}
    with pytest.raises(TaskError, match="legs of six joints"):
        draw_chains(motions, 4, ["crouch"])


def test_it_is_a_gymnasium_environment(toy, tmp_path):
    save_motions(tmp_path / "squats.npz", [squats(toy)], toy)
    settings = {"motions": str(tmp_path / "squats.npz"), "horizon": "medium"}
    size = observation_size(student_keys(), toy)
    for robot in (toy, str(DESCRIPTION)):
        env = gymnasium.make("plat/G1TimedKeyframe-v0", robot=robot, **settings)
        assert env.reset(seed=0)[0].shape == (size,)
        assert env.action_space.shape == (7,)
        assert env.step(np.zeros(7, np.float32))[0].shape == (size,)
    many = gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=2, robot=toy, **settings)
    assert many.reset(seed=0)[0].shape == (2, size)
    with pytest.raises(RobotError, match="robot 'r2d2' is unknown"):
        gymnasium.make("plat/G1TimedKeyframe-v0", robot="r2d2", **settings)


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_its_motions_are_files(toy, tmp_path, suffix):
    clip = squats(toy)
    if suffix == "npz":
        save_motions(tmp_path / "squats.npz", [clip], toy)
    else:
        save_csv(tmp_path, replace(clip, name="squats_30fps"), toy)
    (read,) = load_motions(f"{tmp_path}/*", toy)
    np.testing.assert_allclose(read.qpos, clip.qpos, atol=1e-5)
    library = MotionLibrary.load(f"{tmp_path}/*", toy)
    again = MotionLibrary.load(f"{tmp_path}/*", toy)  # from the cache, which knows the asset's content
    assert torch.equal(library.frames["joint_pos"], again.frames["joint_pos"])


def test_stage_one_learns_and_its_run_is_loaded(toy, motions, tmp_path):
    torch.manual_seed(0)
    expert = Expert(toy, ExpertConfig(hidden=(16,)))
    env = make_tracking_env(motions, 16, TrackingTaskConfig(**SIMULATION), goals=expert.goals)
    critic = Critic(toy, expert.normalizer.in_keys, (16,))
    ppo = PPO(expert.head(), critic.head(), critic.observe(), PPOConfig())
    budget = Budget(steps=300)
    run = Run(
        tmp_path / "run",
        recipe=TrackingTaskConfig(),
        policy=expert,
        budget=budget,
        state={"critic": critic, "optimizer": ppo.optimizer},
        resume=False,
    )
    weights = [parameter.clone() for parameter in expert.parameters()]
    for rollout in rollouts(env, expert.actor(), steps=8):
        budget.add(rollout.numel())
        if critic.normalizer.count > 0:
            losses = ppo.step(rollout, gradient=motor_gradient(rollout, toy))
            assert all(np.isfinite(value) for value in losses.values())
        expert.normalizer.update(rollout)
        critic.normalizer.update(rollout)
        run.log({"reward": float(rollout["next", "reward"].mean())})
        if budget.done:
            break
    run.finish()
    assert any(not torch.equal(*pair) for pair in zip(weights, expert.parameters(), strict=True))
    loaded = load_policy(tmp_path / "run")
    assert loaded.robot is toy
    state = env.reset()
    torch.testing.assert_close(
        loaded.deployed()(state.clone())["action"], expert.eval().deployed()(state.clone())["action"]
    )


def test_a_run_of_a_robot_that_nobody_registered_says_so(toy, tmp_path, monkeypatch):
    write_run(tmp_path / "run", LatentPolicy(toy, SMALL))
    monkeypatch.delitem(registry._ROBOTS, "toy")
    with pytest.raises(CheckpointError, match="robot 'toy' is unknown, expected one of .*register_robot"):
        load_policy(tmp_path / "run")
    get_robot(DESCRIPTION)
    assert load_policy(tmp_path / "run").robot.name == "toy"


@pytest.fixture
def forgotten(toy, motions, tmp_path, monkeypatch) -> list[str]:
    """Flags that name the robot, which is not registered; runs of it are ``expert``, ``one`` and ``other``."""
    save_motions(tmp_path / "squats.npz", [squats(toy)], toy)
    write_run(tmp_path / "expert", Expert(toy, ExpertConfig(hidden=(8,))))
    for name in ("one", "other"):
        write_run(tmp_path / name, LatentPolicy(toy, SMALL))
    monkeypatch.delitem(registry._ROBOTS, "toy")
    return ["--robot", str(DESCRIPTION)]


@pytest.mark.parametrize(
    ("stage", "flags"),
    [
        ("expert", ["--init", "expert"]),
        ("expert-model", ["--init", "expert"]),
        ("distill", ["--expert", "expert"]),
        ("refine", ["--student", "one"]),
        ("refine-model", ["--student", "one"]),
        ("imagine", ["--student", "latent", "--init", "one"]),
    ],
)
def test_every_stage_goes_on_from_a_run_of_a_robot_of_a_file(tmp_path, monkeypatch, forgotten, stage, flags):
    monkeypatch.chdir(tmp_path)
    names = ["--motions", "nowhere.npz", "--out", "out", "--steps", "1"]
    with pytest.raises(SystemExit, match="nowhere.npz"):  # the policy was read before
        main([stage, *flags, *names, *forgotten])


def test_runs_of_a_robot_of_a_file_are_averaged(tmp_path, forgotten, capsys):
    main(["average", str(tmp_path / "one"), str(tmp_path / "other"), "--out", str(tmp_path / "mean"), *forgotten])
    assert capsys.readouterr().out.endswith(f"--motions test.npz --robot {DESCRIPTION}\n")
    assert load_policy(tmp_path / "mean").robot.name == "toy"


@pytest.mark.slow
def test_processes_know_a_robot_of_a_file(tmp_path, forgotten):
    flags = ["--motions", str(tmp_path / "squats.npz"), "--horizon", "short", "mixed", "--workers", "2"]
    main(["evaluate", str(tmp_path / "one"), *flags, "--csv", str(tmp_path / "scores.csv"), *forgotten])
    assert "one,mixed," in (tmp_path / "scores.csv").read_text()


def test_keyframes_are_chased_and_scored(toy, motions):
    student = LatentPolicy(toy, SMALL).eval()
    env = make_keyframe_env(motions, 4, KeyframeTaskConfig(**SIMULATION))
    assert env.rollout(5, student.deployed())["next", "reward"].isfinite().all()
    scores = report(evaluate(student.deployed(), motions, HORIZONS["long"]))
    assert 0 <= scores["tks"].value <= 100
    pose = standing(toy)
    sequence = KeyframeSequence(toy, pose, (pose.at(0.1),))
    steps = list(Chase(PolicyController(student.deployed(), toy), sequence, Simulator(toy.model()), hold=0.04))
    assert len(steps) >= 5


def test_it_is_exported(toy, tmp_path):
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    from plat.export import export_bundle

    torch.manual_seed(0)
    run = write_run(tmp_path / "run", LatentPolicy(toy, SMALL).eval())
    export_bundle(run, tmp_path / "bundle")
    runner = PolicyRunner(tmp_path / "bundle")
    simulator, pose = Simulator(toy.model()), standing(toy)
    simulator.reset(pose)
    ours = runner(simulator.state(), pose, 10)
    theirs = PolicyController(load_policy(run).deployed(), toy)(simulator.state(), pose, 10)
    np.testing.assert_allclose(ours, theirs, atol=1e-4)


def test_tools_that_are_for_the_g1_say_so(toy):
    expected = "expected motion files of this robot"
    with pytest.raises(RobotError, match=f"'toy': motions are generated for the joints of the G1 only, {expected}"):
        MotionLibrary.load(["generated:val@8"], toy)
    with pytest.raises(RobotError, match="robot 'toy': retargeting needs the bodies of the G1, and it lacks"):
        RobotGeometry.of(toy)
    with pytest.raises(RobotError, match="robot 'toy': no joint is called left_... or right_..."):
        mirror_motion(squats(toy), toy)


def test_commands_take_its_description(toy, tmp_path, monkeypatch, capsys):
    motions, out = tmp_path / "squats.npz", tmp_path / "expert"
    save_motions(motions, [squats(toy)], toy)
    # as in a process of its own, which has not heard of the robot
    monkeypatch.setattr(registry, "_ROBOTS", {"g1": registry.G1})
    robot = ["--robot", str(DESCRIPTION)]
    small = ["--num-envs", "4", "--rollout", "8", "--policy.hidden", "8", "--critic", "8", "--steps", "64"]
    main(["expert", *robot, "--motions", str(motions), *small, "--device", "cpu", "--out", str(out)])
    assert load_policy(out).robot == toy
    main(["motions", "inspect", str(motions), *robot])
    main(["keyframes", "from-motion", str(motions), *robot, "--every", "0.5", "--out", str(tmp_path / "k.json")])
    main(["evaluate", str(out), *robot, "--motions", str(motions), "--horizon", "single", "--device", "cpu"])
    printed = capsys.readouterr().out
    assert KeyframeSequence.load(tmp_path / "k.json", toy).robot.name == "toy"
    assert "\nexpert " in printed
    with pytest.raises(SystemExit, match="robot 'toy2' is unknown"):
        main(["expert", "--robot", "toy2", "--motions", str(motions), *small, "--out", str(tmp_path / "other")])


def test_the_commands_take_its_description(toy, tmp_path, monkeypatch, capsys):
    run, pose = write_run(tmp_path / "run", LatentPolicy(toy, SMALL)), standing(toy)
    KeyframeSequence(toy, pose, (pose.at(0.1),)).save(tmp_path / "stand.json")
    play = ["play", "--policy", str(run), "--keyframes", str(tmp_path / "stand.json"), "--hold", "0"]
    monkeypatch.delitem(registry._ROBOTS, "toy")
    with pytest.raises(SystemExit, match="robot 'toy' is unknown"):
        main(play)
    main([*play, "--robot", str(DESCRIPTION)])
    assert "of 1 reached" in capsys.readouterr().out


def test_it_is_exported_and_run_at_the_physics_that_it_can_do(toy, tmp_path, monkeypatch, capsys):
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    run, pose = write_run(tmp_path / "run", LatentPolicy(toy, SMALL)), standing(toy)
    KeyframeSequence(toy, pose, (pose.at(0.1),)).save(tmp_path / "stand.json")
    monkeypatch.delitem(registry._ROBOTS, "toy")
    main(["export", str(run), "--out", str(tmp_path / "bundle"), "--robot", str(DESCRIPTION)])
    keyframes = ["--motions", "--keyframes", str(tmp_path / "stand.json")]
    main(["sim-to-sim", str(tmp_path / "bundle"), *keyframes, "--robot", str(DESCRIPTION)])
    lines = capsys.readouterr().out.splitlines()
    assert "left out: settings with capsule feet, robot 'toy' has no sole_capsules" in lines
    assert any(line.startswith("1 ms physics steps") for line in lines)
    assert not any(line.startswith(("capsule feet", "all: 1 ms")) for line in lines)


def test_feet_that_differ_are_refused_by_name(tmp_path):
    for name in ("toy.json", "toy.xml"):
        (tmp_path / name).write_text((DESCRIPTION.parent / name).read_text())
    model = (tmp_path / "toy.xml").read_text()
    foot = model.index("<geom", model.index('<body name="paw_l"'))
    geom = model[foot : model.index("/>", foot) + 2]
    (tmp_path / "toy.xml").write_text(model.replace(geom, geom + geom, 1))
    robot = get_robot(tmp_path / "toy.json")
    with pytest.raises(RobotError, match="contact geoms: 2 on 'paw_l' and 1 on 'paw_r'; expected as many"):
        robot.sole_geoms(robot.shared_model)


def test_soles_slide_by_their_own_friction_not_by_the_floors(toy):
    model = toy.model()
    data = mujoco.MjData(model)
    data.qpos[:] = toy.default_qpos
    data.qpos[2] -= 0.05
    mujoco.mj_forward(model, data)
    assert {contact.friction[0] for contact in data.contact} == {0.9}
    model.geom_friction[toy.sole_geoms(model), 0] = 0.1
    mujoco.mj_forward(model, data)
    assert {contact.friction[0] for contact in data.contact} == {0.1}


def test_its_curve_of_friction_begins_with_a_test_of_its_own(toy):
    plan = StudyPlan(horizons=["short"], robustness=["friction", "push"], strengths=1)
    assert plan.strengths_of("friction", toy) == (0.8, 0.1)
    assert plan.strengths_of("friction", G1) == (0.1,)
    assert plan.strengths_of("push", toy) == (1.5,)
    library = MotionLibrary.from_clips(squats(toy, frames=30), toy)
    entrant = Entrant.of_policy(LatentPolicy(toy, SMALL))
    candidate = Candidate("toy", lambda: entrant, "as it is")
    study = run_study({candidate: entrant}, library, plan, workers=1)
    friction = {point.strength for point in study.curves if point.disturbance == "friction"}
    assert friction == {0.8, 0.1}
    assert {point.strength for point in study.curves if point.disturbance == "push"} == {0.0, 1.5}


def test_no_part_of_a_light_robot_weighs_less_than_nothing(toy):
    """Of the 0.75 kg of its chest 2 were taken off."""
    physics = BatchedPhysics(toy.model(), 64, 4)
    draws = RandomizedPhysics(toy, physics, 64, ROBOT_RANGES, 0.02)
    seen = []
    physics.set_mass = lambda ids, body, change: seen.append((body, change))
    draws.draw(torch.arange(64))
    ((body, change),) = seen
    mass = float(toy.model().body(body).mass[0])
    assert 0.4 * mass < float(change.abs().max()) <= 0.5 * mass


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<body name="chest"', "<body", "body 2 of .* has no name, expected one"),
        ("</worldbody>", '<body name="table"/></worldbody>', "holds 'table' too, expected the robot alone"),
    ],
)
def test_links_that_nothing_can_be_computed_of_are_named(toy, old, new, message):
    text = toy.asset_path.read_text()
    assert old in text
    model = mujoco.MjModel.from_xml_string(text.replace(old, new, 1))
    with pytest.raises(RobotError, match=f"robot '{toy.name}': .*{message}"):
        link_names(model, toy)
