import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions.formats.table import read_table

VALUES = np.array([[0.5, -1.25, 3e-3, 40.0, 5.0], [1.5, 2.25, -3e-3, 41.0, 6.0], [2.5, 2.5, 0.0, 42.0, 7.0]])
HEADER = "a,b,c,d,e"


def lines(separator: str = ",", end: str = "") -> str:
    return "\n".join(separator.join(f"{value:.10g}" for value in row) + end for row in VALUES)


@pytest.mark.parametrize(
    ("text", "header"),
    [
        (lines(), ""),
        (lines(";"), ""),
        (lines("\t"), ""),
        (lines(" "), ""),
        (lines("   "), ""),
        (lines(", "), ""),
        (lines(" | "), ""),
        (lines("|").replace(".", ","), ""),
        (lines(",", ","), ""),
        (lines(";").replace(".", ","), ""),
        (lines().replace("\n", "\r\n\r\n"), ""),
        ("\ufeff" + lines(), ""),
        (f"# made by a tool\n{lines()}\n# the end", ""),
        (f"{HEADER}\n{lines()}", HEADER),
        (f'"a","b","c","d","e"\n{lines()}', HEADER),
        (f"{HEADER},\n{lines(',', ',')}", HEADER),
        (f"{HEADER}\n{lines(',', ',')}", HEADER),
        (f"# {HEADER}\n{lines()}", HEADER),
        (f"# {HEADER}\n{lines(' ')}", HEADER),
        (f"0,1,2,3,4\n{lines()}", "0,1,2,3,4"),
    ],
)
def test_dialects(tmp_path, text, header):
    (tmp_path / "a.csv").write_text(text)
    table = read_table(tmp_path / "a.csv")
    np.testing.assert_array_equal(table.values, VALUES)
    assert table.header == (header.split(",") if header else [])


@pytest.mark.parametrize("day", ["", "2026-03-01 ", "2026-03-01T"])
def test_times_of_a_day_become_seconds(tmp_path, day):
    rows = "\n".join(f"{day}23:59:{58 + frame / 50:09.6f},{frame}" for frame in range(3))
    (tmp_path / "a.csv").write_text(f"time,b\n{rows}")
    np.testing.assert_allclose(read_table(tmp_path / "a.csv").values[:, 0], [0, 0.02, 0.04])


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_encodings(tmp_path, encoding):
    (tmp_path / "a.csv").write_bytes(f"# f\u00fcr\n{HEADER}\n{lines()}".encode(encoding))
    np.testing.assert_array_equal(read_table(tmp_path / "a.csv").values, VALUES)


def test_a_header_that_is_one_short_lacks_the_name_of_row_numbers(tmp_path):
    (tmp_path / "a.csv").write_text(f"b,c,d,e\n{lines()}")
    assert read_table(tmp_path / "a.csv").header == ["", "b", "c", "d", "e"]


def test_comments_are_kept(tmp_path):
    (tmp_path / "a.csv").write_text(f"# fps: 50\n// by hand\n{lines()}")
    assert read_table(tmp_path / "a.csv").comments == ["fps: 50", "by hand"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("\n", "no rows of numbers"),
        (HEADER, "no rows of numbers"),
        (f"{lines()}\n1,2", "row 4 has 2 columns, row 1 has 5"),
        (f"{lines().replace(',', ';')}\n1", "row 4 has 1 columns, row 1 has 5"),
        (f"# c\n{lines()}\n1,2,x,4,5", "row 5, column 3: 'x' is not a number"),
        (f"a,b\n{lines()}", "the header has 2 columns, the rows have 5"),
    ],
)
def test_errors_name_row_and_column(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(MotionError, match=message):
        read_table(tmp_path / "a.csv")


def test_comments_have_decimal_commas_where_the_numbers_do(tmp_path):
    (tmp_path / "a.csv").write_text(f"# fps: 29,97\n{lines(';').replace('.', ',')}")
    assert read_table(tmp_path / "a.csv").comments == ["fps: 29.97"]
    (tmp_path / "a.csv").write_text(f"# 30,36\n{lines()}")
    assert read_table(tmp_path / "a.csv").comments == ["30,36"]
