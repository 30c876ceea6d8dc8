"""Going on from a smaller student: one that observes less, knows shorter times, or has narrower layers."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from plat.errors import ConfigError
from plat.modules.settings import PlainPolicyConfig
from plat.robots.robot import Robot
from plat.spec.observation import observation_widths, student_keys

__all__ = ["check_parts", "take_over", "widened"]

_FIRST_LAYER = "backbone.module.0.0.weight"
_GAUSSIANS = ("prior.module", "posterior.module")


@torch.no_grad()
def take_over(student: Any, trained: Any) -> None:
    """Give a student the weights of a trained one that observes the same or less and is as wide or narrower.

    At first the student acts like the trained one: its additional inputs have weight 0, and its additional units have
    no outgoing weights yet. The time to the keyframe, ``tau = steps_left / max_steps``, is rescaled to the same number
    of steps. What normalizes, what is symmetric and what is within reach are the student's own settings.

    Args:
        student: a :class:`plat.modules.PlainPolicy` or :class:`plat.modules.LatentPolicy`.
        trained: one of the same class, with as many layers.

    Raises:
        ConfigError: saying what differs.

    Source: function-preserving widening as in Net2Net, arXiv 1511.05641, with new units instead of copied ones.

    >>> from plat.modules import PlainPolicy
    >>> from plat.robots import G1
    >>> from plat.spec.timing import Timing
    >>> student = PlainPolicy(G1, PlainPolicyConfig(also=("clock",), timing=Timing(max_steps=150)))
    >>> take_over(student, PlainPolicy(G1))
    >>> bool((student.backbone.module[0][0].weight[:, 177:] == 0).all())
    True
    """
    check_parts(trained.robot, student.robot)
    ours: PlainPolicyConfig = student.config
    theirs: PlainPolicyConfig = trained.config
    missing = [group for group in theirs.also if group not in ours.also]
    if missing:
        raise ConfigError(f"the trained student observes {missing[0]!r}, this one does not: add it (--policy.also)")
    if ours.hidden_size != theirs.hidden_size and len(student.decoder.widths) > 1:
        raise ConfigError(f"hidden_size: {theirs.hidden_size} of the trained student with a latent, expected the same")
    weights = trained.state_dict()
    if (ours.also, ours.timing.max_steps) != (theirs.also, theirs.timing.max_steps):
        _observe_more(weights, ours, theirs, student.robot)
    state = student.state_dict()
    for name, ours_value in state.items():
        if name not in weights:
            raise ConfigError(f"the trained student has no {name}: both need as many layers")
        weights[name] = widened(name, weights[name], ours_value, _stacked(name, state))
    if len(weights) > len(state):
        raise ConfigError(
            f"the trained student has more than this one: {next(name for name in weights if name not in state)}"
        )
    student.load_state_dict(weights)


def check_parts(trained: Robot, robot: Robot) -> None:
    """Raise an error where weights are of a robot with another number of joints or keypoints.

    Raises:
        ConfigError: saying how many there are.
    """
    for what, theirs, ours in (
        ("joints", trained.joint_names, robot.joint_names),
        ("keypoints", trained.keypoints, robot.keypoints),
    ):
        if len(theirs) != len(ours):
            raise ConfigError(
                f"it was trained on {trained.name!r}, which has {len(theirs)} {what}, expected {len(ours)} as "
                f"{robot.name!r} has"
            )


def _observe_more(weights: dict[str, Tensor], ours: PlainPolicyConfig, theirs: PlainPolicyConfig, robot: Robot) -> None:
    """Put the columns of a trained student's first layer and normalizer where this student has those entries."""
    first_layer = weights.get(_FIRST_LAYER, torch.empty(0))
    if first_layer.shape[1:] != weights["normalizer.mean"].shape:
        raise ConfigError("the trained student's backbone is its own: expected the same also and timing.max_steps")
    seen, now = student_keys(theirs.also), student_keys(ours.also)
    widths = observation_widths(now, robot)
    size = sum(widths)
    columns_of = dict(zip(now, torch.arange(size).split(widths), strict=True))
    columns = torch.cat([columns_of[key] for key in seen])
    mean, var = (weights["normalizer.mean"].new_full((size,), value) for value in (0.5, 0.25))
    mean[columns], var[columns] = weights["normalizer.mean"], weights["normalizer.var"]
    first = first_layer.new_zeros(len(first_layer), size)
    first[:, columns] = first_layer
    horizon, ratio = columns_of["command", "horizon"], ours.timing.max_steps / theirs.timing.max_steps
    eps = ours.normalizer.eps
    before = var[horizon].sqrt() + eps
    mean[horizon], var[horizon] = mean[horizon] / ratio, var[horizon] / ratio**2
    first[:, horizon] *= (var[horizon].sqrt() + eps) * ratio / before
    weights.update({"normalizer.mean": mean, "normalizer.var": var, _FIRST_LAYER: first})


def _stacked(name: str, state: Mapping[str, Tensor]) -> int:
    """Return how many outputs are stacked in a tensor: gates of the encoder's GRU, mean and spread of a Gaussian."""
    if ".gru." in name:
        return 3
    part = name.partition(".network.")[0]
    layers = [int(other.split(".")[-2]) for other in state if other.startswith(f"{part}.network.")]
    return 2 if part in _GAUSSIANS and int(name.split(".")[-2]) == max(layers) else 1


def widened(name: str, trained: Tensor, drawn: Tensor, stacked: int = 1) -> Tensor:
    """Return a trained tensor of a network, or one as large as ``drawn`` with it in its corner.

    The units that it has keep their inputs, and take nothing from new ones. These see what ``drawn`` says.

    Args:
        name: of the tensor, for the message.
        trained: a weight ``[out, in]`` or a bias ``[out]``.
        drawn: the same of the wider network, newly drawn, or a lazy one that takes any size.
        stacked: outputs of one size that are stacked along the first dimension; each is widened by itself.

    Raises:
        ConfigError: when ``drawn`` is narrower.

    >>> widened("weight", torch.ones(1, 1), torch.full((2, 2), 5.0)).tolist()
    [[1.0, 0.0], [5.0, 5.0]]
    """
    if nn.parameter.is_lazy(drawn) or trained.shape == drawn.shape:
        return trained
    if trained.ndim != drawn.ndim or any(a > b for a, b in zip(trained.shape, drawn.shape, strict=True)):
        raise ConfigError(f"the trained policy has {tuple(trained.shape)} for {name}, this one {tuple(drawn.shape)}")
    out = drawn.clone()
    for ours, theirs in zip(out.chunk(stacked), trained.chunk(stacked), strict=True):
        ours[: len(theirs)] = 0.0
        ours[tuple(slice(size) for size in theirs.shape)] = theirs
    return out
