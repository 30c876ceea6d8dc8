from pathlib import Path

import pytest

from tests.export.runs import small_policy, write_run


@pytest.fixture(scope="session")
def shipped_bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundle of imagined-robot-g1, the policy for robots."""
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    from plat.export import export_bundle
    from plat.runs.shipped import shipped_runs

    folder = tmp_path_factory.mktemp("bundles") / "imagined-robot"
    export_bundle(shipped_runs()["imagined-robot-g1"], folder)
    return folder


@pytest.fixture(scope="session")
def small_bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundle of a small policy with random weights, which observes robot, goal and command alone."""
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    from plat.export import export_bundle

    folder = tmp_path_factory.mktemp("bundles") / "small"
    export_bundle(write_run(tmp_path_factory.mktemp("runs") / "plat", small_policy("residual_latent_noise")), folder)
    return folder
