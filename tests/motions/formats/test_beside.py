"""Rates of tables from the same motion beside them."""

import pickle

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import MotionClip, load_motions, read_motion_files, save_motions
from plat.motions.clip import ASSUMED_RATE
from plat.motions.formats.beside import rates_beside
from tests.motions.checks.test_flight import jump

from .writers import bowing_clip, gmr_fields, write_asap, write_csv, write_gmr, write_tracker


@pytest.mark.parametrize("write", [write_tracker, write_gmr, write_asap])
def test_the_same_motion_in_another_format_gives_the_rate(tmp_path, write):
    clip = bowing_clip()
    write_csv(tmp_path / "bow.csv", clip)
    assert rates_beside(tmp_path / "bow.csv", 40) == []
    beside = tmp_path / f"bow{'.npz' if write is write_tracker else '.pkl'}"
    write(beside, clip) if write is not write_asap else write_asap_of_one(beside, clip)
    assert rates_beside(tmp_path / "bow.csv", 41) == [(50, f"{beside.name} beside it")]
    assert rates_beside(tmp_path / "bow.csv", 80) == []
    (file,) = read_motion_files(tmp_path / "bow.csv")
    assert file.clips[0].fps == 50
    assert f"fps from {beside.name} beside it" in file.facts
    beside.write_bytes(b"version https://git-lfs")
    assert rates_beside(tmp_path / "bow.csv", 40) == []


@pytest.mark.parametrize("ending", [".npz", ".pkl"])
def test_a_file_beside_that_contradicts_itself_decides_nothing(tmp_path, ending):
    write_csv(tmp_path / "bow.csv", bowing_clip())
    fields = {**gmr_fields(bowing_clip()), "dt": 0.04}
    if ending == ".npz":
        np.savez(tmp_path / "bow.npz", **fields)
    else:
        (tmp_path / "bow.pkl").write_bytes(pickle.dumps(fields))
    told = f"it states 50 .bow{ending} beside it. and 25 .bow{ending} beside it. frames a second; state which"
    with pytest.raises(MotionError, match=told):
        read_motion_files(tmp_path / "bow.csv")


def write_asap_of_one(path, clip):
    from .writers import asap_motions, joblib_bytes

    path.write_bytes(joblib_bytes(asap_motions(clip, ("bow",))))


def test_what_was_made_of_a_table_of_no_rate_states_none(tmp_path):
    """``convert bow.csv --out bow.npz`` had bow.csv confirmed by it."""
    write_csv(tmp_path / "bow.csv", bowing_clip())
    save_motions(tmp_path / "bow.npz", load_motions(tmp_path / "bow.csv"))
    assert rates_beside(tmp_path / "bow.csv", 40) == []
    assert all(ASSUMED_RATE in clip.notes for clip in load_motions(tmp_path))
    save_motions(tmp_path / "bow.npz", load_motions(tmp_path / "bow.csv", fps=60))
    assert rates_beside(tmp_path / "bow.csv", 40) == [(60, "bow.npz beside it")]


def unstated(clip: MotionClip, path) -> None:
    write_csv(path, clip)


def test_a_set_whose_motions_fall_too_slowly_is_refused(tmp_path):
    unstated(bowing_clip(), tmp_path / "bow.csv")
    unstated(jump(60), tmp_path / "jump.csv")
    with pytest.raises(MotionError, match=r"none of 2 files.*jump.csv': nothing states its frames a second; "):
        read_motion_files(tmp_path)
    # the same with a jump that fits, which also outweighs one that does not
    unstated(jump(30), tmp_path / "fits.csv")
    skipped: list[MotionError] = []
    found = read_motion_files(tmp_path, skipped=skipped)
    assert [file.clips[0].name for file in found] == ["bow", "fits"]
    assert "fps assumed, and its flight fit" in found[1].facts
    assert len(skipped) == 1
    assert all(np.isclose(file.clips[0].fps, 30) for file in found)


def test_each_folder_vouches_for_its_own_rate(tmp_path):
    """A folder at 60 a second was read at 30 beside one that is at 30."""
    for folder in ("sixty", "thirty", "silent"):
        (tmp_path / folder).mkdir()
        unstated(bowing_clip(), tmp_path / folder / "bow.csv")
    unstated(jump(60), tmp_path / "sixty" / "jump.csv")
    for name in ("jump", "hop"):
        unstated(jump(30), tmp_path / "thirty" / f"{name}.csv")
    skipped: list[MotionError] = []
    found = read_motion_files([tmp_path / folder for folder in ("sixty", "thirty", "silent")], skipped=skipped)
    assert {str(file.path.relative_to(tmp_path)) for file in found} == {
        "thirty/bow.csv",
        "thirty/hop.csv",
        "thirty/jump.csv",
        "silent/bow.csv",
    }
    assert any("sixty/bow.csv': nothing states its frames a second, and 1 such files beside" in str(e) for e in skipped)
    skipped = []
    assert not read_motion_files([tmp_path / "sixty", tmp_path / "silent"], skipped=skipped)
    told = next(str(error) for error in skipped if "silent" in str(error))
    assert "silent/bow.csv': nothing states its frames a second, and 1 such files among these do not fit" in told
