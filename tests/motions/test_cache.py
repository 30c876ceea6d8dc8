import os
import re
from pathlib import Path

import numpy as np
import pytest
import torch

from plat.motions import MotionLibrary, cache, save_motions
from plat.motions.cache import CODE, CODE_DIGEST, code_digest, file_digests, read_table, write_table
from plat.motions.store import ClipStore
from tests.conftest import standing_clip


def write(path: Path, rows: torch.Tensor, **facts: object) -> None:
    def build(take):
        for part in rows.split(3):
            take(part)
        return torch.tensor([0]), torch.tensor([len(rows)]), ["a clip, ünïcode"], {"verdicts": {"drop": 2}, **facts}

    write_table(path, rows.shape[1], 0.02, build)


def test_a_table_comes_back_from_pieces(tmp_path):
    rows = torch.randn(10, 7)
    write(tmp_path / "a.safetensors", rows)
    table = read_table(tmp_path / "a.safetensors")
    assert table.rows.equal(rows)
    assert (table.names, table.dt, table.facts) == (["a clip, ünïcode"], 0.02, {"verdicts": {"drop": 2}})
    assert table.length.tolist() == [10]
    assert [path.name for path in tmp_path.iterdir()] == ["a.safetensors"]


def test_facts_may_be_of_any_length(tmp_path):
    rows, said = torch.randn(10, 7), [[30, "skipped: a file"]] * 1000
    write(tmp_path / "a.safetensors", rows, said=said)
    table = read_table(tmp_path / "a.safetensors")
    assert table.rows.equal(rows)
    assert table.facts == {"verdicts": {"drop": 2}, "said": said}


def test_rows_are_mapped_and_a_write_stays_in_the_process(tmp_path):
    write(tmp_path / "a.safetensors", torch.zeros(10, 7))
    table = read_table(tmp_path / "a.safetensors")
    table.rows[2] = 1.0
    assert read_table(tmp_path / "a.safetensors").rows.abs().sum() == 0


def test_a_large_table_is_read_through_once_and_again_after_a_change(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "_LARGE", 1)
    path = tmp_path / "a.safetensors"
    write(path, torch.zeros(10, 7))
    with monkeypatch.context() as patch:
        patch.setattr("plat.motions.cache.zlib.crc32", lambda *_: pytest.fail("it was read through"))
        assert read_table(path) is not None
    content = bytearray(path.read_bytes())
    content[4100] ^= 1
    path.unlink()
    path.write_bytes(content)
    assert read_table(path) is None
    write(path, torch.zeros(10, 7))
    (tmp_path / "a.whole.json").write_text("[nonsense")
    assert read_table(path) is not None


def test_a_build_that_fails_leaves_nothing(tmp_path):
    def build(take):
        take(torch.zeros(3, 7))
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        write_table(tmp_path / "a.safetensors", 7, 0.02, build)
    assert not list(tmp_path.iterdir())


def test_where_the_cache_is(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    for own, of_user, expected in (
        (None, None, ".cache/plat"),
        (None, "relative", ".cache/plat"),
        (None, str(tmp_path / "a"), "a/plat"),
        ("~/b", str(tmp_path / "a"), "b"),
        (str(tmp_path / "c"), None, "c"),
    ):
        for name, value in (("PLAT_CACHE_DIR", own), ("XDG_CACHE_HOME", of_user)):
            monkeypatch.delenv(name, raising=False)
            if value is not None:
                monkeypatch.setenv(name, value)
        assert cache.cache_dir() == tmp_path / expected


@pytest.mark.skipif(os.name != "posix", reason="processes are asked whether they live")
def test_a_build_removes_what_a_killed_one_left(tmp_path):
    (tmp_path / f".0a1b.safetensors-{2**22 + 1}-12345678.part.safetensors").write_bytes(b"gigabytes")
    write(tmp_path / "a.safetensors", torch.randn(10, 7))
    assert [path.name for path in tmp_path.iterdir()] == ["a.safetensors"]


def test_digests_of_large_sets_are_remembered_until_a_file_changes(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "_LARGE", 1)
    monkeypatch.setattr(cache, "_SETTLED", -10.0)  # changes of this moment count as settled
    paths = [tmp_path / name for name in "ab"]
    for path in paths:
        path.write_text("one")
    memory = tmp_path / "memory.json"
    first = file_digests(paths, memory)
    assert first[0] == first[1]
    read = []
    digest = cache._digest
    monkeypatch.setattr(cache, "_digest", lambda path: read.append(path) or digest(path))
    assert file_digests(paths, memory) == first
    assert read == []
    paths[1].unlink()
    paths[1].write_text("two")
    second = file_digests(paths, memory)
    assert (second[0], read) == (first[0], [paths[1]])
    assert second[1] != first[1]
    memory.write_text("{")
    assert file_digests(paths, memory) == second


def test_digests_of_files_that_may_still_change_are_not_remembered(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "_LARGE", 1)
    monkeypatch.setattr(cache, "_SETTLED", 1000.0)
    (tmp_path / "a").write_text("one")
    file_digests([tmp_path / "a"], tmp_path / "memory.json")
    monkeypatch.setattr(cache, "_digest", lambda path: "read again")
    assert file_digests([tmp_path / "a"], tmp_path / "memory.json") == ["read again"]


def test_a_large_library_is_the_same_as_a_small_one(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "motions").mkdir()
    for number in range(3):
        save_motions(tmp_path / "motions" / f"{number}.npz", [standing_clip(f"clip {number}", 31 + number)])
    small = MotionLibrary.load(tmp_path / "motions", cache=False, mirror=True)
    monkeypatch.setattr(cache, "_LARGE", 1)
    monkeypatch.setattr("plat.motions.library.ClipStore", lambda folder: ClipStore(folder, 0, 20_000))
    monkeypatch.setattr("plat.motions.table._CHUNK", 64)
    first = MotionLibrary.load(tmp_path / "motions", mirror=True)
    monkeypatch.setattr("plat.motions.library.load_motions", lambda *_: pytest.fail("the cache was not used"))
    again = MotionLibrary.load(tmp_path / "motions", mirror=True)
    assert small.clip_names == first.clip_names == again.clip_names
    torch.testing.assert_close(first.frames, small.frames, rtol=0, atol=1e-5)
    assert again._table.equal(first._table)


def test_stored_clips_are_equal_and_a_full_disk_keeps_them_in_memory(tmp_path, monkeypatch):
    arrays = [np.random.default_rng(number).normal(size=(5 + number, 36)) for number in range(4)]
    store = ClipStore(tmp_path, in_memory=0, segment=4000)
    kept = [store.keep(values) for values in arrays]
    assert all(isinstance(values, np.memmap) for values in kept)
    for values, stored in zip(arrays, kept, strict=True):
        np.testing.assert_array_equal(stored, values)
    assert not list(tmp_path.iterdir())  # they have no name

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(ClipStore, "_new_segment", full)
    store = ClipStore(tmp_path, in_memory=0)
    assert store.keep(arrays[0]) is arrays[0]


PLAT = Path(cache.__file__).parents[1]


def test_the_key_of_a_cache_changes_with_every_file_of_the_code_that_makes_motions(tmp_path):
    for name in (
        "motions/formats/npz_file.py",
        "motions/retargeting/skeletons/cmu.yaml",
        "robots/g1.py",
        "rotations.py",
        "rotations_np.py",
        "spec/proportions.py",
    ):
        assert (PLAT / name).is_file()
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("as it was")
    seen = {code_digest(tmp_path)}
    (tmp_path / "motions" / "notes.txt").touch()
    assert code_digest(tmp_path) in seen
    for path in (path for path in tmp_path.rglob("*") if path.suffix in (".py", ".yaml")):
        path.write_text("as it is now")
        assert code_digest(tmp_path) not in seen
        seen.add(code_digest(tmp_path))
    assert code_digest(PLAT) == CODE_DIGEST


def test_motions_are_made_by_no_code_that_the_key_of_a_cache_leaves_out():
    """What else the code imports neither reads nor changes a motion."""
    others = {"bounds", "deploy", "errors", "extras", "files", "gpu", "json_file", "lazy", "pools", "precision"}
    others |= {"progress", "words"}
    found = set()
    for name in CODE:
        for path in (PLAT / name).rglob("*.py") if (PLAT / name).is_dir() else [PLAT / name]:
            found |= set(
                re.findall(r"^ *(?:from|import) plat\.([\w.]+)", path.read_text(encoding="utf-8"), re.MULTILINE)
            )
    known = tuple(name.removesuffix(".py").replace("/", ".") for name in CODE)
    assert {name for name in found if name.split(".")[0] not in others and not name.startswith(known)} == set()
