import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions.formats.text_tables import read_table

VALUES = np.array([[0.5, -1.25, 3e-3, 40.0, 5.0], [1.5, 2.25, -3e-3, 41.0, 6.0], [2.5, 2.5, 0.0, 42.0, 7.0]])
HEADER = "a,b,c,d,e"


def lines(separator: str = ",", end: str = "") -> str:
    return "\n".join(separator.join(f"{value:.10g}" for value in row) + end for row in VALUES)


# as Google Sheets writes it where decimals have commas
QUOTED = "\n".join(",".join(f'"{cell.replace(".", ",")}"' for cell in line.split(",")) for line in lines().splitlines())


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
        (f"{HEADER}\n{lines()}\n,,,,\n,,,,", HEADER),
        (f"{HEADER}\n{QUOTED}", HEADER),
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
        (f"{lines().replace(',', ';')}\n1", "row 4 has 1 column, row 1 has 5"),
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


@pytest.mark.parametrize(
    "before",
    [
        "Frame rate;50{0}\n",
        "fps;50\n",
        "Walk{0};\nFrame rate;50{0}\nFrames;3{0}\n{0};\n",
        '"# Frame rate 50"{0}\n',
    ],
)
def test_what_excel_has_before_a_table_is_a_comment(tmp_path, before):
    width = 16
    header = [f"a{column}" for column in range(width)]
    rows = "\n".join(";".join([f"{frame},5"] * width) for frame in range(3))
    (tmp_path / "a.csv").write_text(f"{before.format(';' * (width - 2))}{';'.join(header)}\n{rows}")
    table = read_table(tmp_path / "a.csv")
    assert (table.header, table.values.shape) == (header, (3, width))
    assert any("50" in comment for comment in table.comments)


def test_empty_cells_are_no_numbers_and_remembered(tmp_path):
    (tmp_path / "a.csv").write_text("a,b,c,d\n1,2,3,\n1,,3,4\n1,2,3,\n")
    table = read_table(tmp_path / "a.csv")
    assert np.isnan(table.values).sum() == 3
    assert table.empty == {1: 3, 3: 2}
    (tmp_path / "a.csv").write_text("1,2,3,4\n1,,3,4\n")
    with pytest.raises(MotionError, match="row 2, column 2 is empty, expected a number"):
        read_table(tmp_path / "a.csv")


@pytest.mark.parametrize("mark", [":", ";"])
def test_timecodes_have_the_rate_of_their_frames(tmp_path, mark):
    def times(codes: list[int]) -> np.ndarray:
        rows = "\n".join(f"01:00:{code // 25:02d}{mark}{code % 25:02d}\t1\t2\t3" for code in codes)
        (tmp_path / "a.csv").write_text(f"Timecode\ta\tb\tc\n{rows}")
        return read_table(tmp_path / "a.csv").values[:, 0]

    np.testing.assert_allclose(times([*range(20, 60)]), np.arange(40) / 25)
    np.testing.assert_array_equal(times([*range(10)]), np.arange(10))  # within a second nothing tells the rate


def test_a_column_with_another_text_in_each_row_is_left_out(tmp_path):
    (tmp_path / "a.csv").write_text("image,b,c,d\n0.png,1,2,3\n1.png,1,2,3\n2.png,1,2,3\n")
    assert read_table(tmp_path / "a.csv").header == ["b", "c", "d"]


@pytest.mark.parametrize(
    "spell",
    [
        lambda time: f"{time:.2f}s",
        lambda time: f"{time:.2f} sec",
        lambda time: f"{1e3 * time:.0f} ms",
        lambda time: f"{1e6 * time:.0f}us",
        lambda time: f"0:00:{time:06.3f}",
        lambda time: f"00:{time:06.3f}",
        lambda time: f"03/14/2026 10:00:{time:06.3f}",
        lambda time: f"14.03.2026 9:59:{time:06.3f}",
        lambda time: f"2026-03-14T10:00:{time:06.3f}Z",
    ],
)
def test_times_that_are_texts_become_seconds(tmp_path, spell):
    times = 58 + 0.02 * np.arange(60)
    texts = [spell(time) for time in times[times < 60]]
    (tmp_path / "a.csv").write_text("time,b,c,d\n" + "\n".join(f"{text},1,2,3" for text in texts))
    np.testing.assert_allclose(read_table(tmp_path / "a.csv").values[:, 0], 0.02 * np.arange(len(texts)), atol=1e-6)


@pytest.mark.parametrize("repeated", [1, 2])
def test_texts_that_are_left_out_are_remembered(tmp_path, repeated):
    texts = [f"10:00 and {n // repeated} frames" for n in range(6)]
    (tmp_path / "a.csv").write_text("b,time,c,d\n" + "\n".join(f"1,{text},2,3" for text in texts))
    table = read_table(tmp_path / "a.csv")
    assert (table.header, table.texts) == (["b", "c", "d"], {1: ("time", "10:00 and 0 frames")})
