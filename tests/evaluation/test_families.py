from pathlib import Path

import pytest

from plat.errors import RecordsError
from plat.evaluation.families import families_of, read_manifest


def test_families_are_a_column(tmp_path):
    (tmp_path / "one.csv").write_text("clip,source,family\na,x,walk\nb,y,jump\n")
    (tmp_path / "two.csv").write_text("family,clip\nrun,c\n")
    families = read_manifest([tmp_path / "one.csv", tmp_path / "two.csv"])
    assert families_of(["b", "c", "a", "unknown"], families) == ["jump", "run", "walk", "other"]


def test_the_mark_that_spreadsheets_begin_a_file_with_is_no_part_of_a_name(tmp_path):
    (tmp_path / "clips.csv").write_text("clip,family\na,run\n", encoding="utf-8-sig")
    assert read_manifest([tmp_path / "clips.csv"]) == {"a": "run"}


@pytest.mark.parametrize("file", ["motions/hard_free.npz", "hard_free/run_c0.csv"])
def test_a_clip_named_apart_by_its_file_or_folder_is_found(file):
    assert families_of(["hard_free_run_c0"], {"run_c0": "run"}, [Path(file)]) == ["run"]


def test_a_clip_whose_name_ends_as_another_is_not_taken_for_it():
    files = [Path("clips.npz")]
    assert families_of(["walk", "moon_walk"], {"walk": "locomotion"}, files) == ["locomotion", "other"]


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(RecordsError, match="nothing.csv.*not a readable CSV"):
        read_manifest([tmp_path / "nothing.csv"])
    with pytest.raises(RecordsError, match="its name holds a null byte"):
        read_manifest([tmp_path / "a\0b.csv"])
    (tmp_path / "bad.csv").write_text("clip,kind\na,walk\n")
    with pytest.raises(RecordsError, match=r"bad.csv.*no column \['family'\]"):
        read_manifest([tmp_path / "bad.csv"])
    with pytest.raises(RecordsError, match="names none of the 1 clip, which are called 'z'"):
        families_of(["z"], {"a": "walk"})


def test_manifests_that_are_cut_off_or_no_tables_take_one_short_line(tmp_path):
    path = tmp_path / "manifest.csv"
    path.write_text("clip,seconds,family\na,2,walk\nb,3\n")
    with pytest.raises(RecordsError, match=r"manifest.csv', line 3: fewer cells than the head"):
        read_manifest([path])
    path.write_text("1" * 100_000)
    with pytest.raises(RecordsError, match="no column") as refused:
        read_manifest([path])
    assert len(str(refused.value)) < 500


def test_a_clip_of_two_families_is_named_with_both(tmp_path):
    one, two = tmp_path / "one.csv", tmp_path / "two.csv"
    one.write_text("clip,family\na,walk\nb,jump\na,walk\n")
    two.write_text("clip,family\nc,run\nb,dance\n")
    assert read_manifest([one, one]) == {"a": "walk", "b": "jump"}
    with pytest.raises(RecordsError, match=r"two.csv', line 3: family of 'b' is 'dance', and 'jump' before"):
        read_manifest([one, two])


def test_no_clips_have_no_families():
    assert families_of([], {"a": "walk"}) == []
