import json
from pathlib import Path

import pytest

from plat.baselines import CATALOG, ReleasedTrackers, Tracker
from plat.baselines.catalog import sha256
from plat.cli import candidates, main
from plat.cli.candidates import Loaded, candidates_of, trackers_of
from plat.errors import PlatError
from plat.evaluation.cells import Cell
from plat.export import export_bundle
from plat.modules import Expert, ExpertConfig, PlainPolicy
from plat.robots import G1
from plat.runs import load_policy
from tests.modules.policies.test_student import SMALL
from tests.recipes.runs import save_run

INTERFACES = ("next-frame", "line", "cascade")


@pytest.fixture
def runs(tmp_path) -> Path:
    save_run(tmp_path / "plain", PlainPolicy(G1, SMALL))
    save_run(tmp_path / "expert", Expert(G1, ExpertConfig(hidden=(8,))))
    return tmp_path


def names(*arguments, **options) -> list[str]:
    return [candidate.name for candidate in candidates_of(*arguments, **options)]


def test_dense_trackers_are_there_once_for_each_interface(runs):
    paths = (runs / "plain", runs / "expert")
    assert names(paths, ReleasedTrackers()) == ["plain", "expert"]
    found = candidates_of(paths, ReleasedTrackers(), interfaces=INTERFACES)
    assert [one.name for one in found] == ["plain", *(f"expert, {interface}" for interface in INTERFACES)]
    assert len({one.fingerprint for one in found}) == 4
    assert {one.weights for one in found} == {sha256(path / "model.safetensors") for path in paths}
    assert [entrant.view.interface for entrant in found.values()] == ["next-frame", *INTERFACES]
    # the dense reference leaves nothing to choose
    assert names(paths, ReleasedTrackers(), interfaces=INTERFACES, dense=True) == ["plain", "expert"]


@pytest.mark.parametrize("dense", [False, True])
def test_records_of_what_no_interface_is_for_do_not_depend_on_it(runs, dense):
    paths = (runs / "plain", runs / "expert") if dense else (runs / "plain",)
    marks = [
        {one.fingerprint for one in candidates_of(paths, ReleasedTrackers(), dense=dense, interfaces=(interface,))}
        for interface in INTERFACES
    ]
    assert marks[0] == marks[1] == marks[2]


def test_two_files_of_one_tracker_are_refused(tmp_path, monkeypatch):
    for name in ("one.onnx", "two.onnx"):
        (tmp_path / name).write_bytes(b"")
    monkeypatch.setattr(candidates, "identify", lambda path: CATALOG["TWIST2"])
    monkeypatch.setattr(type(CATALOG["TWIST2"]), "load", lambda self, path: Tracker(G1))
    one, two = tmp_path / "one.onnx", tmp_path / "two.onnx"
    assert names((one,), ReleasedTrackers(twist2=one)) == ["TWIST2"]
    for paths, trackers in (((one,), ReleasedTrackers(twist2=two)), ((one, two), ReleasedTrackers())):
        with pytest.raises(PlatError, match=r"TWIST2 is given twice, as '.*\.onnx' and '.*\.onnx'"):
            candidates_of(paths, trackers)


def test_a_bundle_is_shown_the_reference_as_its_run_is(runs):
    pytest.importorskip("onnxscript")
    pytest.importorskip("onnxruntime")
    export_bundle(runs / "plain", runs / "bundle")
    paths = (runs / "plain", runs / "bundle", runs / "bundle" / "policy.onnx")
    of_dense = [candidates_of(paths, ReleasedTrackers(), dense=dense) for dense in (False, True)]
    assert [[entrant.view.dense for entrant in found.values()] for found in of_dense] == [[False] * 3, [True] * 3]
    # records of one are none of the other
    assert not {one.fingerprint for one in of_dense[0]} & {one.fingerprint for one in of_dense[1]}


def test_runs_of_one_name_are_told_apart(runs):
    save_run(runs / "other" / "plain", PlainPolicy(G1, SMALL))
    paths = (runs / "plain", runs / "other" / "plain")
    assert names(paths, ReleasedTrackers()) == [str(path) for path in paths]


def test_a_folder_that_one_is_in_has_its_name(runs, monkeypatch):
    monkeypatch.chdir(runs / "plain")
    assert names((Path("."),), ReleasedTrackers()) == ["plain"]
    monkeypatch.chdir(runs)
    (runs / "plain" / "within").mkdir()
    assert names((Path("plain/within/.."), Path("expert")), ReleasedTrackers()) == ["plain", "expert"]


def test_other_weights_have_another_fingerprint(runs):
    (first,) = candidates_of((runs / "plain",), ReleasedTrackers())
    save_run(runs / "plain", PlainPolicy(G1, SMALL))
    (second,) = candidates_of((runs / "plain",), ReleasedTrackers())
    assert first.fingerprint != second.fingerprint
    assert first.weights != second.weights


def test_a_tracker_that_was_never_run_with_its_weights_is_marked(tmp_path, monkeypatch):
    (tmp_path / "model_encoder.onnx").write_bytes(b"a")
    (tmp_path / "model_decoder.onnx").write_bytes(b"b")
    monkeypatch.setattr(type(CATALOG["SONIC"]), "load", lambda self, path: Tracker(G1))
    trackers = ReleasedTrackers(sonic_1_1=tmp_path)
    assert names((), trackers) == ["SONIC 1.1 (unverified)"]
    assert names((), trackers, interfaces=("next-frame", "line")) == [
        "SONIC 1.1 (unverified), next-frame",
        "SONIC 1.1 (unverified), line",
    ]


def test_released_files_are_known_by_their_content(shared_data, tmp_path):
    pytest.importorskip("onnxruntime")
    renamed = tmp_path / "policy.onnx"
    renamed.write_bytes((shared_data / "baselines/wbc/policy_066ab15.onnx").read_bytes())
    assert names((renamed,), ReleasedTrackers()) == ["wbc"]


def test_a_policy_is_loaded_once_for_all_interfaces_and_the_dense_reference(runs, monkeypatch):
    read: list[str] = []

    def load_tracker(self, path):
        read.append(self.version)
        return Tracker(G1)

    def load_run(path, device):
        read.append(path.name)
        return load_policy(path, device)

    for name in ("model_encoder.onnx", "model_decoder.onnx"):
        (runs / name).write_bytes(name.encode())
    monkeypatch.setattr(type(CATALOG["SONIC"]), "load", load_tracker)
    monkeypatch.setattr(candidates, "load_policy", load_run)
    given = (runs / "plain", runs / "expert"), ReleasedTrackers(sonic=runs, sonic_1_1=runs)
    loaded: Loaded = {}
    found = candidates_of(*given, interfaces=INTERFACES, loaded=loaded)
    dense = trackers_of(*given, loaded=loaded)
    sonic = [CATALOG[name].version for name in ("SONIC", "SONIC 1.1")]
    assert read == ["plain", "expert", *sonic]
    assert len(found) == 1 + 3 * 3
    assert [one.name for one in dense] == ["expert", "SONIC (unverified)", "SONIC 1.1 (unverified)"]
    assert all(entrant.view.dense for entrant in dense.values())
    assert not {one.fingerprint for one in found} & {one.fingerprint for one in dense}
    again = trackers_of(*given)
    assert [one.fingerprint for one in again] == [one.fingerprint for one in dense]


def test_nothing_to_evaluate():
    with pytest.raises(PlatError, match=r"nothing to evaluate: .*twist2\)$"):
        candidates_of((), ReleasedTrackers(), lists={"--motions": ("clips.npz",), "--manifest": ()})


def test_a_run_after_an_option_of_several_is_named(runs):
    (runs / "bundle").mkdir()
    (runs / "bundle" / "bundle.json").write_text("{}")
    for name in (runs / "plain", runs / "bundle", "plat-g1", "twist2.onnx"):
        with pytest.raises(PlatError, match=f"; '{name}' stands after --motions and was taken for one of it: put it f"):
            candidates_of((), ReleasedTrackers(), lists={"--motions": ("clips.npz", str(name))})
    with pytest.raises(SystemExit, match="'plat-g1' stands after --motions and was taken for one of it: put it first"):
        main(["evaluate", "--motions", "clips.npz", "plat-g1"])
    with pytest.raises(SystemExit, match="'plat-g1' stands after --hard and was taken for one of it: put it first"):
        main(["benchmark", "--out", str(runs / "out"), "--hard", "clips.npz", "plat-g1"])


def test_a_run_that_is_not_finished_is_said_to_be(runs, capsys):
    path = runs / "plain"
    config = json.loads((path / "config.json").read_text())
    trackers = ReleasedTrackers()
    candidates_of([path], trackers)
    assert "not finished" not in capsys.readouterr().out
    (path / "config.json").write_text(json.dumps({**config, "recipe": {"name": "distill"}}))
    candidates_of([path], trackers)
    assert f"{path.name}: its training is not finished" in capsys.readouterr().out


def test_names_that_make_one_file_name_are_told_apart(runs, tmp_path):
    paths = [save_run(tmp_path / name, PlainPolicy(G1, SMALL)) for name in ("my-run", "my_run", "my run")]
    stems = [Cell(one, "mixed").stem for one in candidates_of(paths, ReleasedTrackers())]
    assert stems[0] == "my_run-mixed"  # as alone
    assert len(set(stems)) == 3
    assert names(paths, ReleasedTrackers()) == ["my-run", "my_run", "my run"]


def test_rows_of_one_name_are_refused(runs):
    path = runs / "plain"
    with pytest.raises(PlatError, match=r"two rows are called '.*plain': give each policy once"):
        candidates_of((path, path), ReleasedTrackers())
