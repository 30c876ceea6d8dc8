import pytest

from plat.files import replace_file


def test_a_failed_write_leaves_the_file_before_it_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    replace_file(path, lambda part: part.write_text("first"))

    def half(part):
        part.write_text("sec")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        replace_file(path, half)
    assert path.read_text() == "first"
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]


def test_the_new_file_can_be_read_by_others(tmp_path):
    replace_file(tmp_path / "a.txt", lambda part: part.write_text("x"))
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o644
