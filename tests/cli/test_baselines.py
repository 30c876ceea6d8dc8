import hashlib
from pathlib import Path

import pytest

from plat.baselines import CATALOG
from plat.cli import baselines
from plat.cli.options import BaselinesRecipe
from plat.errors import PlatError


def test_the_list_says_whose_each_is_and_how_to_get_it(capsys):
    baselines.main(BaselinesRecipe())
    out = capsys.readouterr().out
    for baseline in CATALOG.values():
        for fact in (baseline.owner, baseline.version, baseline.license, baseline.get, f"--trackers.{baseline.flag}"):
            assert fact in out
    assert out.count("unverified") == sum(not baseline.tested for baseline in CATALOG.values())
    assert "plat ships none of these files" in out


def test_a_file_is_identified_by_its_content(tmp_path, capsys, monkeypatch):
    known, unknown = tmp_path / "anything.onnx", tmp_path / "other.onnx"
    known.write_bytes(b"as if it were the tracker")
    unknown.write_bytes(b"something else")
    digest = hashlib.sha256(known.read_bytes()).hexdigest()
    monkeypatch.setitem(CATALOG["wbc"].files, "policy_066ab15.onnx", digest)  # type: ignore[arg-type]
    baselines.main(BaselinesRecipe(files=(known, unknown)))
    first, second = capsys.readouterr().out.splitlines()
    assert first == f"{known}: wbc, {CATALOG['wbc'].version}"
    assert second == f"{unknown}: not known (SHA-256 {hashlib.sha256(b'something else').hexdigest()})"


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(PlatError, match=r"'nothing\.onnx': no such file"):
        baselines.main(BaselinesRecipe(files=(Path("nothing.onnx"),)))
    with pytest.raises(PlatError, match=r": is a folder, expected a file"):
        baselines.main(BaselinesRecipe(files=(tmp_path,)))
