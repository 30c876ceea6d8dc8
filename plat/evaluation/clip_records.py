"""Records of whole clips: one row per clip, with the rule that it was judged by."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from plat.errors import RecordsError
from plat.evaluation.records import join_columns, read_columns, write_columns

__all__ = ["CLIP_ERRORS", "ClipRecords"]

CLIP_ERRORS = ("joint_error", "keypoint_error", "keypoint_error_root", "vel_dist", "accel_dist")
"""Errors that are averaged over the frames before a failure."""


@dataclass
class ClipRecords:
    """One row for each of the C clips, followed once from its first frame.

    Attributes:
        rule: name of the success rule.
        clip: number of the clip ``[C]``.
        frames: control steps of the clip ``[C]``.
        tracked: control steps before the failure ``[C]``; all of them in a success.
        failed: by the rule ``[C]``.
        errors: for each of :data:`CLIP_ERRORS`, the sum over the tracked steps ``[C]``: joints (rad), keypoints in the
            world (m), in their own root's frame (m), and the distance of the keypoints' displacements a frame (m/frame)
            and of their changes (m/frame²). The last two are those of PHC.
        source: motion that the clip is a piece of ``[C]``; None where clips are whole motions.
    """

    rule: str
    clip: Tensor
    frames: Tensor
    tracked: Tensor
    failed: Tensor
    errors: dict[str, Tensor]
    source: Tensor | None = None

    def columns(self) -> dict[str, Tensor]:
        """Return every column by its name in files."""
        columns = {name: value for name, value in vars(self).items() if isinstance(value, Tensor)}
        return columns | {f"errors.{name}": column for name, column in self.errors.items()}

    @classmethod
    def from_columns(cls, columns: Mapping[str, Tensor], rule: str) -> "ClipRecords":
        """Return the table of :meth:`columns`.

        Raises:
            KeyError, TypeError: when one is missing, or unknown.
        """
        rest = dict(columns)
        errors = {name: rest.pop(f"errors.{name}") for name in CLIP_ERRORS}
        return cls(rule, **rest, errors=errors)

    def of_rows(self, rows: Tensor) -> "ClipRecords":
        """Return the rows that a mask ``[C]`` or indices choose."""
        return self.from_columns({name: column[rows] for name, column in self.columns().items()}, self.rule)

    def of_clips(self, clips: Sequence[int]) -> "ClipRecords":
        """Return the rows of some clips."""
        return self.of_rows(torch.isin(self.clip, torch.tensor(clips)))

    @classmethod
    def joined(cls, parts: "Sequence[ClipRecords]") -> "ClipRecords":
        """Return the rows of several tables, one after the other.

        Raises:
            RecordsError: when they were judged by different rules; for no tables, and a column that one of them lacks.
        """
        columns = join_columns([part.columns() for part in parts])
        rules = {part.rule for part in parts}
        if len(rules) != 1:
            raise RecordsError(f"clips judged by the rules {sorted(rules)}, expected one rule in a table")
        return cls.from_columns(columns, rules.pop())

    def save(self, path: Path, about: Mapping[str, Any]) -> None:
        """Write the table, its rule and a description of it (JSON values) to a ``.safetensors`` file."""
        write_columns(path, self.columns(), {**about, "rule": self.rule})

    @classmethod
    def load(cls, path: Path) -> "tuple[ClipRecords, dict[str, Any]]":
        """Return the table of a file and its description.

        Raises:
            RecordsError: when the file cannot be read or is another kind of file.
        """
        records, about = read_columns(path, lambda columns: cls.from_columns(columns, ""))
        if not isinstance(about.get("rule"), str):
            raise RecordsError(f"{str(path)!r}: does not say by which success rule its clips were judged")
        records.rule = about["rule"]
        return records, about
