"""Metrics of a run as a CSV file."""

import csv
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from plat.errors import OutputError
from plat.files import replace_file

__all__ = ["MetricsFile"]


class MetricsFile:
    """CSV writer of metrics with one row a step; columns are added as new metrics come up.

    Training never stops for its sake. A damaged file is put aside, with its readable rows kept, and what a full disk
    did not take is written once it can be.

    Args:
        path: the file.
        keep_until: rows of later steps are dropped, which a killed run wrote after its last checkpoint.

    Attributes:
        dropped: whether there were such rows.

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
        self.dropped = False
        self._columns = ["step"]
        self._rows: list[dict[str, Any]] = []
        self._behind = False
        """Whether the file lacks rows."""
        if path.exists():
            self._read(keep_until)
        self.rewrite()

    def write(self, step: int, metrics: Mapping[str, float]) -> None:
        """Append a row."""
        row = {"step": step, **{name: f"{value:.6g}" for name, value in metrics.items()}}
        self._rows.append(row)
        new = [name for name in row if name not in self._columns]
        self._columns += new
        if new or self._behind:
            self.rewrite()
            return
        try:
            with self.path.open("a", newline="", encoding="utf-8") as file:
                csv.DictWriter(file, self._columns, lineterminator="\n").writerow(row)
        except OSError as error:
            self._fall_behind(error)

    def rows(self) -> Iterator[tuple[int, dict[str, float]]]:
        """Yield step and metrics of each row; cells that are empty or no numbers are left out."""
        for row in self._rows:
            metrics = {}
            for name in row.keys() - {"step", "seconds"}:
                with suppress(ValueError):
                    metrics[name] = float(row[name])
            yield int(row["step"]), metrics

    def _read(self, keep_until: int) -> None:
        damage = None
        try:
            lines = self.path.read_bytes().decode("utf-8", errors="replace").splitlines()
            columns, *rows = [_cells(line) for line in lines] or [[]]
            if columns[:1] != ["step"] or len(set(columns)) < len(columns):
                raise ValueError(f"its first line is {','.join(columns)[:40]!r}, expected 'step,...'")
            self._columns = columns
            good = [len(row) == len(columns) and row[0].isdecimal() and len(row[0]) < 19 for row in rows]
            readable = [
                dict(zip(columns, row, strict=True)) for row, is_good in zip(rows, good, strict=True) if is_good
            ]
            self._rows = [row for row in readable if int(row["step"]) <= keep_until]
            self.dropped = len(self._rows) < len(readable)
            # a kill cuts the last line at most
            if not all(good[:-1]):
                damage = "lines that are no rows are left out"
        except (OSError, ValueError) as error:
            damage = str(error)
        if damage is not None:
            aside = self.path.with_name(f"damaged-{self.path.name}")
            print(f"{str(self.path)!r} is damaged ({damage}): kept as {aside.name}, going on", flush=True)
            try:
                self.path.replace(aside)
            except OSError as error:
                self._fall_behind(error)

    def rewrite(self) -> None:
        """Write all rows."""
        try:
            replace_file(self.path, self._write_all)
        except (OSError, OutputError) as error:
            self._fall_behind(error)
        else:
            self._behind = False

    def close(self) -> None:
        """Write what the file still lacks; say so where it cannot be."""
        if self._behind:
            self.rewrite()
        if self._behind:
            print(f"{str(self.path)!r} lacks rows of this run: it could not be written to the end", flush=True)

    def _fall_behind(self, error: OSError | OutputError) -> None:
        if not self._behind:
            told = getattr(error, "strerror", None) or error
            print(
                f"{str(self.path)!r} cannot be written ({told}): rows are kept, training goes on",
                flush=True,
            )
        self._behind = True

    def _write_all(self, part: Path) -> None:
        with part.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, self._columns, lineterminator="\n")
            writer.writeheader()
            writer.writerows(self._rows)


def _cells(line: str) -> list[str]:
    """Return the cells of a line; none where it is no text, or no CSV."""
    try:
        return [] if "\0" in line or "\ufffd" in line else next(csv.reader([line]), [])
    except csv.Error:
        return []
