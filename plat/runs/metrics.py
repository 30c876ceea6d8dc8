"""Metrics of a run as a CSV file."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plat.files import replace_file

__all__ = ["MetricsFile"]


class MetricsFile:
    """CSV writer of metrics with one row a step; columns are added as new metrics come up.

    Args:
        path: the file.
        keep_until: rows of later steps are dropped, which a killed run wrote after its last checkpoint.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     metrics = MetricsFile(Path(folder) / "metrics.csv")
    ...     metrics.write(1, {"loss": 0.5})
    ...     metrics.write(2, {"loss": 0.25, "kl": 0.01})
    ...     print(metrics.path.read_text(), end="")
    step,loss,kl
    1,0.5,
    2,0.25,0.01
    """

    def __init__(self, path: Path, keep_until: int = 0):
        self.path = path
        self._columns = ["step"]
        self._rows: list[dict[str, Any]] = []
        if path.exists():
            with path.open(newline="") as file:
                reader = csv.DictReader(file)
                self._columns = list(reader.fieldnames or ["step"])
                # a row cut short by a kill has no number in its first column, or fewer columns
                self._rows = [row for row in reader if 0 <= _step(row) <= keep_until]
        self._rewrite()

    def write(self, step: int, metrics: Mapping[str, float]) -> None:
        """Append a row."""
        row = {"step": step, **{name: f"{value:.6g}" for name, value in metrics.items()}}
        self._rows.append(row)
        new = [name for name in row if name not in self._columns]
        if new:
            self._columns += new
            self._rewrite()
            return
        with self.path.open("a", newline="") as file:
            csv.DictWriter(file, self._columns, lineterminator="\n").writerow(row)

    def _rewrite(self) -> None:
        replace_file(self.path, self._write_all)

    def _write_all(self, part: Path) -> None:
        with part.open("w", newline="") as file:
            writer = csv.DictWriter(file, self._columns, lineterminator="\n")
            writer.writeheader()
            writer.writerows(self._rows)


def _step(row: Mapping[str, str]) -> int:
    try:
        return int(row["step"]) if None not in row.values() else -1
    except (TypeError, ValueError):
        return -1
