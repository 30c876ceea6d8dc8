import json

import pytest

from plat.deploy import PolicyRunner
from tests.export.runs import small_policy, write_run
from tests.in_process import Ended, run_plat

pytest.importorskip("onnx")
pytest.importorskip("onnxscript")
pytest.importorskip("onnxruntime")


def export(*arguments: object) -> Ended:
    return run_plat("export", *arguments)


def test_a_run_becomes_a_bundle(tmp_path):
    run = write_run(tmp_path / "plat", small_policy("residual_latent"))
    (run / "evaluation.csv").write_text("policy,horizon,metric,value,low,high\nplat,long,tks,99.5,99.25,99.75\n")
    result = export(run, "--out", tmp_path / "bundle")
    assert result.returncode == 0, result.stderr
    assert "README.md, bundle.json, example.json" in result.stdout
    assert "policy.onnx, scene.xml" in result.stdout
    assert "largest difference from torch over 1,024 observations: " in result.stdout
    assert "Warning" not in result.stderr
    assert PolicyRunner(tmp_path / "bundle").bundle.scores[0].value == 99.5
    assert json.loads((tmp_path / "bundle" / "bundle.json").read_text())["scores"][0]["metric"] == "tks"


def test_a_broken_run_is_one_clear_line(tmp_path):
    run = write_run(tmp_path / "plat", small_policy("residual_latent"))
    (run / "model.safetensors").write_bytes(b"broken")
    result = export(run, "--out", tmp_path / "bundle")
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1
    assert "model.safetensors': not a readable safetensors file" in result.stderr
    assert not (tmp_path / "bundle").exists()
