import pytest

from plat.baselines import CATALOG, ReleasedTrackers, identify
from plat.errors import CheckpointError


def test_every_tracker_has_a_flag_and_all_that_one_must_know():
    assert list(ReleasedTrackers().files()) == list(CATALOG)
    for baseline in CATALOG.values():
        for fact in (baseline.owner, baseline.version, baseline.license, baseline.get):
            assert fact
        assert all(baseline.files.values()) or not baseline.tested  # what was run has a hash


def test_unverified_ones_are_marked():
    marked = {name for name, baseline in CATALOG.items() if "unverified" in baseline.described()}
    assert marked == {"SONIC", "SONIC 1.1", "ProtoMotions"}


def test_released_files_are_identified(shared_data, tmp_path):
    folder = shared_data / "baselines"
    files = ("twist2/twist2_1017_20k.onnx", "wbc/policy_066ab15.onnx", "yahmp/g1_yahmp.onnx")
    found = [identify(folder / file) for file in files]
    assert [baseline.name for baseline in found if baseline] == ["TWIST2", "wbc", "YAHMP"]


def test_a_wrong_file_is_named(shared_data):
    wbc = shared_data / "baselines/wbc/policy_066ab15.onnx"
    with pytest.raises(CheckpointError, match="is wbc's .*policy_066ab15, expected TWIST2's twist2_1017_20k.onnx"):
        CATALOG["TWIST2"].load(wbc)


def test_another_version_of_a_file_is_told(shared_data, tmp_path, capsys):
    pytest.importorskip("onnxruntime")
    other = tmp_path / "other.onnx"
    other.write_bytes((shared_data / "baselines/wbc/policy_066ab15.onnx").read_bytes())
    CATALOG["wbc"].load(other)
    assert "not the released" not in capsys.readouterr().out
    (tmp_path / "changed.onnx").write_bytes(_changed(other.read_bytes()))
    with pytest.raises(CheckpointError, match="from 132 to 29 numbers"):
        CATALOG["TWIST2"].load(tmp_path / "changed.onnx")
    assert "not the released twist2_1017_20k.onnx" in capsys.readouterr().out


def _changed(content: bytes) -> bytes:
    """The same network with one more entry of metadata, and so with another hash."""
    import onnx

    model = onnx.load_from_string(content)
    model.metadata_props.add(key="changed", value="yes")
    return model.SerializeToString()
