"""Authored keyframes in a comparison: records that are kept on disk and taken up again."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from plat.control.authored import Authored
from plat.errors import ActionError, RecordsError
from plat.evaluation.authored_rollout import Pushes
from plat.evaluation.authored_scores import (
    AuthoredRecords,
    AuthoredScore,
    author_families,
    evaluate_authored,
    no_chains,
)
from plat.evaluation.cells import Candidate, Cell, fingerprint, of_others, robot_fingerprint
from plat.evaluation.entrant import Entrant
from plat.evaluation.groups import GroupScore
from plat.evaluation.report import Estimate
from plat.evaluation.score_table import AUTHORED_METRICS
from plat.evaluation.setting import EvaluationSetting
from plat.motions.library import MotionLibrary
from plat.robots.robot import Robot
from plat.spec.timing import Timing
from plat.version import __version__

__all__ = ["AUTHORED", "authored_groups", "authored_records", "records_of_all"]

AUTHORED = "authored"
"""Name of the test in tables and files."""


def authored_records(
    candidate: Candidate,
    entrant: Entrant,
    motions: MotionLibrary,
    count: int,
    setting: EvaluationSetting,
    folder: Path | None = None,
    chains: Sequence[Authored] | None = None,
    pushes: Pushes | None = None,
) -> AuthoredRecords:
    """Return a candidate's records of ``count`` chains of every authored family; those in the folder if it has them.

    Args:
        candidate: with its fingerprint.
        entrant: its policy, loaded. A dense tracker is shown keyframes by its interface.
        motions: source of resting poses; its robot is the one that was chosen.
        count: chains per family.
        setting: its seed, device and threads.
        folder: for the records; None keeps nothing.
        chains: which takes seconds to draw; None to draw them here.
        pushes: of the robots.
    """
    if chains is None:
        chains = author_families(motions.robot, motions, count, setting.seed, entrant.timing)
    if not chains:
        raise RecordsError(f"{candidate.name}: {no_chains(entrant.timing)}")
    about = _about(candidate, motions.robot, chains, pushes)
    path = None if folder is None else folder / f"{Cell(candidate, AUTHORED).stem}.safetensors"
    if path is not None and path.exists():
        try:
            records, known = AuthoredRecords.load(path)
            if not (others := of_others(known, about)):
                return records
            print(f"evaluated again, and replaced: {str(path)!r} of {', '.join(others)}")
        except RecordsError as error:
            print(f"evaluated again: {error}")
    try:
        records = evaluate_authored(
            entrant.policy,
            entrant.robot,
            chains,
            observe=entrant.view.keyframes().transforms,
            pushes=pushes,
            num_threads=setting.num_threads,
            device=setting.device,
        )
    except ActionError as error:
        raise ActionError(f"{candidate.name}: {error}") from error
    if path is not None:
        records.save(path, about)
    return records


def records_of_all(
    entrants: Mapping[Candidate, Entrant],
    motions: MotionLibrary,
    count: int,
    setting: EvaluationSetting,
    folder: Path | None = None,
    pushes: Pushes | None = None,
) -> Iterator[tuple[Candidate, AuthoredRecords]]:
    """Yield each candidate and its records, as of :func:`authored_records`; chains are drawn once for all alike.

    A candidate whose commands are too short for every family is left out, and told of.
    """
    chains: dict[tuple[int, Timing], list[Authored]] = {}
    for candidate, entrant in entrants.items():
        key = (id(entrant.robot), entrant.timing)
        if key not in chains:
            own = motions.for_robot(entrant.robot)
            chains[key] = author_families(entrant.robot, own, count, setting.seed, entrant.timing)
        if not chains[key]:
            print(f"{candidate.name}: {no_chains(entrant.timing)}")
            continue
        yield candidate, authored_records(candidate, entrant, motions, count, setting, folder, chains[key], pushes)


def authored_groups(policy: str, records: AuthoredRecords) -> list[GroupScore]:
    """Return the scores of a policy by authored family."""
    scores = []
    for family in dict.fromkeys(records.family):
        score = AuthoredScore.of(records, family)
        figures = {name: Estimate(*getattr(score, name)) for name in AUTHORED_METRICS}
        scores.append(GroupScore(policy, AUTHORED, family, score.chains, figures))
    return scores


def _about(candidate: Candidate, robot: Robot, chains: Sequence[Authored], pushes: Pushes | None) -> dict[str, Any]:
    """Return what the records depend on. Chains are fingerprinted themselves: a change of their families is seen."""
    parts = []
    for chain in chains:
        for keyframe in chain.sequence.keyframes:
            told = (chain.family, chain.hold, keyframe.time, keyframe.commands)
            parts += [repr(told).encode(), keyframe.qpos.tobytes()]
    about = {"policy": candidate.fingerprint, "chains": fingerprint(parts), "plat": __version__}
    if mark := robot_fingerprint(robot):
        about |= {"robot": mark}
    return about if pushes is None else about | {"pushes": asdict(pushes)}
