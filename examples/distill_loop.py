"""Stage 2 in a loop of your own: the student acts, the expert labels, the posterior teaches the prior.

python examples/distill_loop.py
"""

import torch

import plat
from plat.collectors import ExpertLabels, dagger_buffer, rollouts
from plat.envs import make_keyframe_env
from plat.modules import STUDENT_KEYS, Expert, LatentPolicy
from plat.motions import MotionLibrary
from plat.objectives import LatentImitationLoss
from plat.robots import G1

expert = plat.load("expert-g1")
assert isinstance(expert, Expert)
motions = MotionLibrary.load(["generated:train@60"])
env = make_keyframe_env(motions, num_envs=16, dense_goals=expert.dense_goals)
labeled = ExpertLabels(expert.labels(), STUDENT_KEYS)

student = LatentPolicy(G1)
loss = LatentImitationLoss(student.training_graph(), beta=0.01)
optimizer = torch.optim.Adam(student.parameters(), lr=1e-3)
buffer = dagger_buffer(motions, capacity=10_000, batch_size=64, stride=5)

for number, rollout in enumerate(rollouts(env, student.sampled(), steps=8)):
    states = labeled(rollout)  # [128], with the expert's actions
    buffer.extend(states)
    student.update_normalizers(states)
    losses = loss(buffer.sample())  # samples come with their way to the keyframe
    optimizer.zero_grad()
    (losses["loss_posterior"] + losses["loss_prior"] + losses["loss_kl"]).backward()
    optimizer.step()
    if number == 2:
        break
