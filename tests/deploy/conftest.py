from pathlib import Path

import pytest

from tests.export.runs import small_policy, write_run


@pytest.fixture(scope="session")
def run(tmp_path_factory) -> Path:
    """A run of a small PLAT policy with random weights."""
    return write_run(tmp_path_factory.mktemp("runs") / "plat", small_policy("residual_latent_noise"))


@pytest.fixture(scope="session")
def bundle(run, tmp_path_factory, quick_exports) -> Path:
    """Its bundle."""
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    from plat.export import export_bundle

    folder = tmp_path_factory.mktemp("bundles") / "plat"
    export_bundle(run, folder)
    return folder
