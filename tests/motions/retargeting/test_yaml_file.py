import pytest

from plat.errors import MotionError
from plat.motions.retargeting.yaml_file import read_yaml

pytest.importorskip("yaml")


def test_everything_but_objects_and_lists_is_a_text(tmp_path):
    (tmp_path / "a.yaml").write_text("a: 1.50\nb: [yes, ~, 2001-01-01]\nc: {d: 0x10}\n")
    assert read_yaml(tmp_path / "a.yaml", "it") == {"a": "1.50", "b": ["yes", "~", "2001-01-01"], "c": {"d": "0x10"}}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"a: &x [1, 2]\nb: *x", r"has a reference \(\*name\), expected plain values"),
        (b"a: 1\na: 2", "field 'a' comes twice in one object"),
        (b"a: {b: 1, b: 2}", "field 'b' comes twice in one object"),
        (b"[" * 20_000, r"not a readable YAML file \(nested too deeply\)"),
        (b"a: [1", r"not a readable YAML file \(line 1, column 6: .*\)"),
        (b"a: \xff\xfe", r"not a readable YAML file \(byte 3 is no UTF-8\)"),
        (b"a: \x00", "not a readable YAML file"),
        (b"# " + b"x" * (65 << 10), "67 KB, expected at most 64 KB"),
    ],
)
def test_what_is_refused_is_told_in_one_line(tmp_path, text, message):
    (tmp_path / "a.yaml").write_bytes(text)
    with pytest.raises(MotionError, match=rf"^it: {message}") as raised:
        read_yaml(tmp_path / "a.yaml", "it")
    assert "\n" not in str(raised.value)


def test_what_is_no_file(tmp_path):
    with pytest.raises(MotionError, match="it: no such file"):
        read_yaml(tmp_path / "nowhere.yaml", "it")
    with pytest.raises(MotionError, match="it: not a regular file"):
        read_yaml(tmp_path, "it")
