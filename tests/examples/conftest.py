from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shipped_bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundle of imagined-g1."""
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    from plat.export import export_bundle
    from plat.runs.shipped import shipped_runs

    folder = tmp_path_factory.mktemp("bundles") / "imagined"
    export_bundle(shipped_runs()["imagined-g1"], folder)
    return folder
