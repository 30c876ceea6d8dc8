"""Distill a student from a released dense tracker: the ONNX policy of wbc-mjlab teaches in the place of plat's expert.

python examples/teacher.py policy_066ab15.onnx --motions generated:train@60 --out runs/from-wbc --steps 200000
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import tyro

from plat.baselines import Wbc
from plat.collectors import ExpertLabels, MixedPolicy, dagger_buffer, rollouts
from plat.envs import make_keyframe_env
from plat.modules import STUDENT_KEYS, LatentPolicy, LatentPolicyConfig, Teacher
from plat.motions import MotionLibrary
from plat.objectives import LatentImitationLoss
from plat.runs import Budget, Run, report_errors


@dataclass
class TeacherExample:
    """Distill a student from the tracker of wbc-mjlab."""

    tracker: Annotated[Path, tyro.conf.Positional]
    """the .onnx file of wbc-mjlab"""
    motions: tuple[str, ...]
    """motion files, folders or globs"""
    out: Path
    """folder to write the run to"""
    steps: int = 200_000
    """environment steps, all robots together"""
    num_envs: int = 256
    """robots that are simulated at a time"""
    teacher_share: float = 0.5
    """fraction of the steps that the teacher takes"""
    policy: LatentPolicyConfig = LatentPolicyConfig()
    """sizes of the student"""


def main(example: TeacherExample) -> None:
    """Run the example."""
    teacher: Teacher = Wbc(example.tracker)
    motions = MotionLibrary.load(example.motions)
    env = make_keyframe_env(motions, example.num_envs, dense_goals={}, transforms=teacher.references(motions))
    student = LatentPolicy(teacher.robot, example.policy)
    loss = LatentImitationLoss(student.training_graph(), beta=0.01)
    optimizer = torch.optim.Adam(student.parameters(), lr=1e-3)
    buffer = dagger_buffer(motions, capacity=200_000, batch_size=2048, stride=5)
    budget = Budget(steps=example.steps)
    run = Run(example.out, recipe=example, policy=student, budget=budget, state={"optimizer": optimizer})
    # the tracker remembers its last action: it labels while the robots are simulated
    policy = MixedPolicy(student.sampled(), teacher.labels(), example.teacher_share, keep_labels=teacher.stateful)
    labeled = ExpertLabels(None if teacher.stateful else teacher.labels(), STUDENT_KEYS)
    for rollout in rollouts(env, policy, steps=8):
        states = labeled(rollout)
        budget.add(len(states))
        buffer.extend(states)
        student.update_normalizers(states)
        for _ in range(8):
            losses = loss(buffer.sample())
            optimizer.zero_grad()
            (losses["loss_posterior"] + losses["loss_prior"] + losses["loss_kl"]).backward()
            optimizer.step()
        run.log({name: float(value) for name, value in losses.detach().items()})
        if budget.done:
            break
    run.finish()


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(TeacherExample))
