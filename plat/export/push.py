"""Upload of a run to the Hugging Face Hub with its card."""

from pathlib import Path

from plat.errors import CheckpointError
from plat.export.card import run_card
from plat.export.facts import describe_policy
from plat.modules import Expert
from plat.runs import SavedRun, run_folder, upload_run

__all__ = ["push_run"]


def push_run(run: str | Path, name: str, *, private: bool = True) -> None:
    """Upload a run with a card; ``plat.load(name)`` loads it anywhere. Log in first: ``hf auth login``.

    Its settings, weights and learned model are uploaded, and its scores, also from a table beside its directory.

    Args:
        run: directory of a policy that chases keyframes.
        name: ``"hf:owner/name"``.
        private: whether a new repository is private.

    Raises:
        CheckpointError: when the run cannot be read or the Hub does not take it.
    """
    folder = run_folder(run)
    saved = SavedRun(folder)
    policy = saved.policy()
    if isinstance(policy, Expert):
        raise CheckpointError(f"{str(run)!r} holds an expert, expected a policy that chases keyframes")
    card = run_card(describe_policy(policy, saved), saved, name)
    upload_run(folder, name, card, private=private, scores=saved.scores or ())
