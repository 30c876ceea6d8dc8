"""Model card of a bundle."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from plat.deploy.bundle import Bundle, BundleScore
from plat.evaluation.report import Estimate
from plat.evaluation.score_table import HEADLINE, METRICS
from plat.export.data_sets import license_table, licenses_told
from plat.runs.saved_run import SavedRun

__all__ = ["model_card", "run_card"]

_USE = """```python
from plat.deploy import PolicyRunner, RobotState

runner = PolicyRunner("path/to/this/folder", joint_names=names_of_your_joints)
runner.reset()
command = runner.step(state, keyframe, time_left=0.4)  # once every {dt:g} s; a RobotState, a pose in the world, seconds
send(command.position, command.stiffness, command.damping)
```"""


def model_card(bundle: Bundle, run: SavedRun, max_difference: float, files: Collection[str] = ()) -> str:
    """Return Markdown that describes the policy: architecture, training, scores and limits.

    Args:
        bundle: what the bundle says about itself.
        run: whose policy it is.
        max_difference: of a joint target between exported and torch policy (rad).
        files: names of optional files of the bundle: ``scene.xml``, ``picture.png``.
    """
    robot, training = bundle.robot, bundle.training
    pose = "pose, whole or in part" if "parts" in bundle.also else "whole-body pose"
    made_by = "an unknown recipe" if training.recipe is None else f"`plat {training.recipe}`"
    parts = [
        f"# {training.run}: timed keyframes on the {robot.name}",
        f"A policy that takes a {robot.name} ({len(robot.joint_names)} joints) to one future {pose}, at most "
        f"{bundle.timing.longest:g} s ahead, and arrives on time. It asks for joint position targets "
        f"every {robot.control_dt:g} s.",
        *(["![The robot in its default pose](picture.png)"] if "picture.png" in files else []),
        "`policy.onnx` is the network with its metadata inside, `bundle.json` the same metadata, `example.json` a step "
        "to check another program against. "
        + ("`scene.xml` is the robot on a floor, for MuJoCo. " if "scene.xml" in files else "")
        + "plat's `docs/deploy.md` explains every field.",
        "## Use\n\nNeeds numpy and onnxruntime.\n\n" + _USE.format(dt=robot.control_dt),
        f"## Training\n\nA `{bundle.policy.kind}` policy, made by {made_by} in the run `{training.run}` (plat "
        f"{training.plat}, torch {training.torch}, commit {training.commit}). Motions of that run, "
        "or of those that it is the mean of:\n\n"
        + _motions(run.motions)
        + "\n\nTheir licenses bind what the policy may be used for. Runs that it began with may have seen others.",
        "## Scores\n\n" + _score_table(bundle.scores),
        f"## Limits\n\n{_limits(run.settings)} Exported and torch policy differ by at most {max_difference:.2g} rad.",
    ]
    return "\n\n".join(parts) + "\n"


def run_card(bundle: Bundle, run: SavedRun, name: str) -> str:
    """Return the card of a run on the Hugging Face Hub: front matter, use, training, scores and limits.

    Args:
        bundle: what a bundle of it would say.
        run: whose policy it is.
        name: ``"hf:owner/name"``.
    """
    parts = [
        "---\nlibrary_name: plat-rl\npipeline_tag: robotics\nlicense: other\ntags: [plat, humanoid, keyframes]\n---",
        f"# {name.partition('/')[2]}: timed keyframes on the {bundle.robot.name}",
        f"A `{bundle.policy.kind}` policy of plat for the {bundle.robot.name}.",
        f'```python\nimport plat  # plat with its extra hub\n\npolicy = plat.load("{name}").deployed()\n```',
        "## Training\n\nMotions of its last run, or of those that it is the mean of:\n\n" + _motions(run.motions),
        "## Scores\n\n" + _score_table(bundle.scores),
        f"## Limits\n\n{_limits(run.settings)}",
    ]
    return "\n\n".join(parts) + "\n"


def _motions(motions: Sequence[str]) -> str:
    if not motions:
        return "unknown"
    return f"{license_table(motions)}\n\n{licenses_told(motions)}"


def _score_table(scores: tuple[BundleScore, ...] | None) -> str:
    if scores is None:
        return "None: no `evaluation.csv` in the run directory, or beside it, holds rows of it in usual conditions."
    figures = {(score.horizon, score.metric): score for score in scores}
    lines = [
        "| commands | " + " | ".join(METRICS[name].heading for name in HEADLINE) + " |",
        "|---|" + "---|" * len(HEADLINE),
    ]
    for horizon in dict.fromkeys(score.horizon for score in scores):
        cells = (_cell(figures.get((horizon, metric))) for metric in HEADLINE)
        lines.append(f"| {horizon} | " + " | ".join(cells) + " |")
    return "Timed keyframes in simulation, with 95 % intervals over motions:\n\n" + "\n".join(lines)


def _cell(score: BundleScore | None) -> str:
    return "-" if score is None else METRICS[score.metric].text(Estimate(score.value, score.low, score.high))


def _limits(settings: Mapping[str, Any]) -> str:
    """Return the limits of the training, as far as the run's settings state them."""
    # learning by imagination has one strength for all
    everything = settings.get("disturbed")
    task = settings.get("task", {}) if everything is None else {"noise": everything, "randomization": everything}
    # runs of version 0.1 have a boolean beside the ranges
    names = (("noise", "observation_noise"), ("randomization", "domain_randomization"))
    absent = [old.replace("_", " ") for new, old in names if task.get(old, task.get(new, True)) in (False, None, 0)]
    if absent:
        return f"Trained without {' and '.join(absent)}: a policy for simulation, not for a robot."
    return "Scored in simulation only."
