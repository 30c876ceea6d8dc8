"""Average of the weights of runs that came from one another."""

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from plat.bounds import Positive, check_value
from plat.errors import CheckpointError, ConfigError
from plat.files import check_folder, copy_file
from plat.modules import LatentPolicy, PlainPolicy, WalkingReach, take_over
from plat.runs.changes import differing
from plat.runs.dynamics import DYNAMICS_FILE
from plat.runs.json_object import write_json
from plat.runs.locate import CONFIG_FILE
from plat.runs.lock import RunLock
from plat.runs.outputs import WEIGHTS_FILE, check_out
from plat.runs.policies import policy_spec
from plat.runs.saved_run import SavedRun, save_weights
from plat.words import counted

__all__ = ["average_runs", "average_weights"]

# Exploration, and the spread of a latent: nothing of them is left in what acts.
_HARMLESS = {"init_std", "min_std"}
# Of students: see plat.modules.take_over.
_TAKEN_OVER = {
    "also",
    "backbone",
    "decoder",
    "encoder_size",
    "hidden_size",
    "latent_size",
    "max_steps",
    "posterior",
    "prior",
}


def average_weights(policies: Sequence[nn.Module], shares: Sequence[float]) -> dict[str, Tensor]:
    """Return the weighted mean of the weights of policies of one architecture; the last one's of what is no float.

    Args:
        policies: policies.
        shares: weight of each; their sum is 1.

    Raises:
        ConfigError: when a tensor's shape differs.

    Source: model soups (Wortsman et al. 2022).

    >>> one, other = nn.Linear(1, 1, bias=False), nn.Linear(1, 1, bias=False)
    >>> _ = nn.init.constant_(one.weight, 1.0), nn.init.constant_(other.weight, 3.0)
    >>> average_weights([one, other], [0.25, 0.75])["weight"].tolist()
    [[2.5]]
    """
    states = [policy.state_dict() for policy in policies]
    last = states[-1]
    for state in states:
        differing = sorted(set(state) ^ set(last)) or [name for name in last if state[name].shape != last[name].shape]
        if differing:
            raise ConfigError(f"average: {differing[0]!r} differs in shape, expected policies of one architecture")
    mean = dict(last)
    for name, tensor in last.items():
        if tensor.is_floating_point():
            parts = torch.stack([share * state[name].double() for share, state in zip(shares, states, strict=True)])
            mean[name] = parts.sum(0).to(tensor)
    return mean


def _like(last: nn.Module, policy: nn.Module) -> nn.Module:
    """Return a student in the shape of the last one, whose new units it takes; others are returned as they are."""
    if not isinstance(last, (LatentPolicy, PlainPolicy)) or getattr(policy, "config", None) == last.config:
        return policy
    wider = copy.deepcopy(last, {id(last.robot): last.robot})
    take_over(wider, policy)
    return wider


def _check_meaning(run: SavedRun, policy: nn.Module, last: SavedRun, policy_of_last: nn.Module) -> None:
    """Raise an error when weights of two policies of a kind mean different things.

    Raises:
        CheckpointError: naming the field in which they differ.
    """
    if run.kind != last.kind:
        raise CheckpointError(
            f"{str(run.folder)!r} holds a {run.kind!r} policy, and {str(last.folder)!r} a {last.kind!r}"
        )
    student = isinstance(policy, (LatentPolicy, PlainPolicy))
    for name, (own, of_last) in differing(policy_spec(policy), policy_spec(policy_of_last)):
        field = name.rpartition(".")[2]
        # one that got a reach on the way sees what is within it as before, a symmetric one means the same on each side
        gained = field in ("reach", "symmetric") and not own
        if not (gained or field in _HARMLESS or (student and field in _TAKEN_OVER)):
            raise CheckpointError(
                f"{str(run.folder)!r}: policy.{name} is {own!r}, expected {of_last!r} as in {str(last.folder)!r}: "
                "weights of the two mean different things"
            )


def _give(run: SavedRun, policy: Any, **fields: Any) -> None:
    """Give a policy, or the student that it refines, other settings that its weights serve as well.

    Raises:
        CheckpointError: for a policy that has no such setting.
        RobotError: when it is to be symmetric, and its robot is not.
    """
    acts = getattr(policy, "student", policy)
    for name in fields:
        if not hasattr(acts.config, name):
            raise CheckpointError(
                f"--{name}: {str(run.folder)!r} holds a {run.kind!r} policy, which has no such setting; expected "
                "a student, alone or refined, or an expert that is to be symmetric"
            )
    acts.config = replace(acts.config, **fields)
    policy.deployed()  # is put together with them


def average_runs(
    runs: Sequence[str | Path],
    out: Path,
    shares: Sequence[float] = (),
    symmetric: bool = False,
    reach: WalkingReach | None = None,
) -> SavedRun:
    """Write a run whose weights are the mean of those of others, and return it.

    Policies that were trained on from one another, or from a common one, often gain by it, at no cost when they act.
    Its settings, and its model of the robot where there is one, are those of the last. ``average`` in its
    ``config.json`` lists the averaged runs, and what each was trained on. A student may be narrower than the last
    run's, which started from it. It then counts as the wide student that acts like it (:func:`plat.modules.take_over`).

    Args:
        runs: two or more run directories, or names of shipped weights; with ``symmetric`` or a ``reach`` one will do.
        out: directory to write to.
        shares: weight of each; none for equal ones. They are scaled to a sum of 1.
        symmetric: let it act by the mean of its action and the mirrored one (:class:`plat.modules.BothSides`).
        reach: show it keyframes beyond this nearer (:class:`plat.modules.KeyframeReach`); of a student, alone or
            refined.

    Raises:
        ConfigError: for less than two runs, another number of shares, or a share that is no number above 0.
        CheckpointError: when a run cannot be read, or its policy is of another kind or size, or differs in what its
            weights mean, such as the base of the action; for one that cannot be ``symmetric`` or be given a ``reach``.
        RobotError: when the robot of a ``symmetric`` one is not.
        OutputError: when the disk does not take the model of the robot. What is written by then is removed.
    """
    if len(runs) < (1 if symmetric or reach else 2):
        alone = "; with one, --symmetric lets it act by both sides, and --reach default shows it far keyframes nearer"
        raise ConfigError(f"runs: {len(runs)}, expected two or more to average{alone if runs else ''}")
    if shares and len(shares) != len(runs):
        raise ConfigError(f"--shares: {counted(len(shares), 'number')}, expected {len(runs)}, one for each run")
    for share in shares:
        check_value("--shares", share, Positive)
    largest = max(shares, default=1.0)  # divided by first: the sum may be too large for a number
    scaled = [float(share / largest) for share in shares] or [1.0] * len(runs)
    parts = [share / math.fsum(scaled) for share in scaled]
    check_folder(out)
    check_out(out, resume=False)
    saved = [SavedRun(run) for run in runs]
    last = saved[-1]
    policies = [run.policy_as(nn.Module, "weights") for run in saved]
    policy = policies[-1]
    for run, one in zip(saved, policies, strict=True):
        _check_meaning(run, one, last, policy)
    try:
        policy.load_state_dict(average_weights([_like(policy, one) for one in policies], parts))
    except ConfigError as error:
        raise CheckpointError(f"{', '.join(str(run.folder) for run in saved)}: {error}") from None
    config = dict(last.config)
    given: dict[str, Any] = ({"symmetric": True} if symmetric else {}) | ({"reach": reach} if reach else {})
    if given:
        _give(last, policy, **given)
        config["policy"] = policy_spec(policy)
    of = [
        {"run": str(name), "share": share, "motions": run.motions}
        | {key: run.config.get(key) for key in ("finished", "made_with")}
        for name, run, share in zip(runs, saved, parts, strict=True)
    ]
    lock = RunLock(out)  # a training that has no checkpoint yet may have it
    try:
        check_out(out, resume=False)  # once more: now nobody else can begin one
        try:
            # the weights last: a folder without them holds nothing that is worth keeping
            # of one run too: the scores of a run are not those of what was made of it
            write_json(out / CONFIG_FILE, {"average": of, **config} if len(runs) == 1 else {**config, "average": of})
            (out / DYNAMICS_FILE).unlink(missing_ok=True)  # of a start that was killed
            if (last.folder / DYNAMICS_FILE).exists():
                copy_file(last.folder / DYNAMICS_FILE, out / DYNAMICS_FILE, "the model of the robot")
            save_weights(out / WEIGHTS_FILE, policy)
        except BaseException:
            for name in (WEIGHTS_FILE, DYNAMICS_FILE, CONFIG_FILE):
                (out / name).unlink(missing_ok=True)
            raise
    finally:
        lock.release()
    return SavedRun(out)
