"""One module a file format, and what reads pickles without running them."""

from collections.abc import Callable
from pathlib import Path

from plat.motions.formats.bvh_file import read_bvh_motion
from plat.motions.formats.common import MotionFile, QuatOrder, ReadOptions
from plat.motions.formats.csv_file import csv_text, read_csv
from plat.motions.formats.npz_file import read_npz
from plat.motions.formats.pickle_file import read_pickle

__all__ = ["READERS", "MotionFile", "QuatOrder", "ReadOptions", "csv_text"]

READERS: dict[str, Callable[[Path, ReadOptions], MotionFile]] = {
    ".npz": read_npz,
    ".csv": read_csv,
    ".pkl": read_pickle,
    ".pickle": read_pickle,
    ".joblib": read_pickle,
    ".bvh": read_bvh_motion,
}
"""Reader of each file ending."""
