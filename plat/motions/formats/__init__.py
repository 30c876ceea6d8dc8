"""Files with motions of a robot: one module a format, and what reads pickles without running them."""

from plat.motions.formats.common import MotionFile, QuatOrder, ReadOptions
from plat.motions.formats.csv_file import csv_text, read_csv
from plat.motions.formats.npy_file import read_npy
from plat.motions.formats.npz_file import read_npz
from plat.motions.formats.pickle_file import read_pickle
from plat.motions.formats.plat_file import check_clip_names, write_archive

__all__ = [
    "MotionFile",
    "QuatOrder",
    "ReadOptions",
    "check_clip_names",
    "csv_text",
    "read_csv",
    "read_npy",
    "read_npz",
    "read_pickle",
    "write_archive",
]
