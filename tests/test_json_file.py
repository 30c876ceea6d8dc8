import time
from pathlib import Path

import pytest

from plat.errors import KeyframeError
from plat.json_file import parse_json, read_json, short


def test_values_come_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(b'\xef\xbb\xbf{"a": [1, -2.5e3, true, null], "b": {"c": "\\u00e9\\ud83d\\ude00"}}')
    assert read_json(path, KeyframeError, "file") == {"a": [1, -2500.0, True, None], "b": {"c": "é😀"}}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_windows_writes_texts_of_other_encodings(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"name": "Köln 😀"}', encoding=encoding)
    assert read_json(path, KeyframeError, "file") == {"name": "Köln 😀"}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "line 1, column 1"),
        (b'{"a": 1,\n "b": }', "line 2, column 7"),
        (b'{"\xff": 1}', "byte 2 is no UTF-8"),
        (b'{"a": 1, // mine\n "b": 2}', r"line 1, column 10.*; JSON has no comments\)$"),
        (b'# mine\n{"a": 1}', r"; JSON has no comments\)$"),
        (b'{"a": 1,\n}', r"; JSON has no comma before a closing bracket\)$|trailing comma"),
        (b'{"a": [1, ]}', r"; JSON has no comma before a closing bracket\)$|trailing comma"),
        (b"\xff\xfe", "line 1, column 1"),
        ('{"a": 1}'.encode("utf-16-le") + b"\x00", "byte 16 is no UTF-16-LE"),
        (b'{"a": NaN}', "holds NaN"),
        (b"[-Infinity]", "holds -Infinity"),
        (b'{"a": 1, "b": 2, "a": 3}', "field 'a' comes twice"),
        (b"[" * 200_000, "nested too deeply"),
        (b'{"a":' * 100_000 + b"1" + b"}" * 100_000, "nested too deeply"),
        (b"[" + b"9" * 5_000 + b"]", "thousands of digits"),
        (b'{"name": "\\ud800"}', "surrogate"),
        (b'{"\\udfff": 1}', "surrogate"),
    ],
)
def test_everything_else_is_one_line(content: bytes, reason: str) -> None:
    with pytest.raises(KeyframeError, match=reason) as raised:
        parse_json(content, KeyframeError, "file 'a.json'")
    message = str(raised.value)
    assert message.startswith("file 'a.json': ")
    assert "\n" not in message
    assert len(message.encode()) < 200


def test_a_name_that_is_repeated_among_many_is_found_at_once() -> None:
    content = b"{" + b",".join(b'"%d":0' % (number // 2 if number > 79_990 else number) for number in range(80_000))
    started = time.process_time()
    with pytest.raises(KeyframeError, match="comes twice"):
        parse_json(content + b"}", KeyframeError, "file")
    assert time.process_time() - started < 10  # it was 25 s: a count for every name


def test_files_that_are_none_are_named(tmp_path: Path) -> None:
    for path, reason in ((tmp_path / "nothing.json", "no such file"), (tmp_path, "not a regular file")):
        with pytest.raises(KeyframeError, match=f"^that one: {reason}"):
            read_json(path, KeyframeError, "that one")
    big = tmp_path / "big.json"
    with big.open("wb") as file:
        file.truncate(1 << 30)  # sparse: takes no disk
    with pytest.raises(KeyframeError, match="1074 MB, expected at most 34 MB"):
        read_json(big, KeyframeError, "that one")


def test_values_in_messages_are_short() -> None:
    for value in ("x" * 10_000, list(range(10_000)), {"a": {"b": "\ud800" * 1000}}):
        assert len(short(value).encode()) < 400


@pytest.mark.parametrize("item", [b"{}", b"[]"])
def test_a_million_empty_objects(item: bytes) -> None:
    with pytest.raises(KeyframeError, match="file: more than 1,000,000 objects and lists, expected fewer"):
        parse_json(b"[" + b",".join([item] * 1_000_000) + b"]", KeyframeError, "file")


def test_references_of_references_are_short_in_messages() -> None:
    value: list[object] = ["x"]
    for _ in range(30):
        value = [value] * 10
    assert len(short(value)) < 500
