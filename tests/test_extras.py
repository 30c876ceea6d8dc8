"""What needs a package of an extra says so in one line where that is not installed."""

import ast
import importlib
import re
import sys
import tomllib
from pathlib import Path

import pytest
import torch

import plat
from plat.baselines import OnnxPolicy, ProtoMotions
from plat.cli import studio
from plat.collectors.cluster import check_ray
from plat.deploy.onnx_session import open_session
from plat.envs.settings import check_physics
from plat.errors import PlatError, RenderingError
from plat.export.onnx_file import onnx_model
from plat.extras import importing
from plat.figures.pyplot import pyplot
from plat.motions.retargeting import retarget
from plat.motions.retargeting.yaml_file import read_yaml
from plat.rendering.pictures import check_video
from plat.runs.loggers import check_logger

ROOT = Path(__file__).parents[1]
WEIGHTS = ROOT / "plat" / "weights" / "plat"


def constant(path: Path) -> None:
    network = object.__new__(OnnxPolicy)  # whose session needs a file of its own
    network._path = path
    network.constant("mean")


def described(path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("plat.baselines.protomotions.open_session", lambda path: None)
        ProtoMotions(path)


def page(path: Path) -> None:
    studio.main(studio.StudioRecipe(runs=(WEIGHTS,)))


USES = {
    ("onnx", "baselines"): constant,
    ("onnx", "export"): lambda path: onnx_model(torch.nn.Linear(3, 2), 3, {}),
    ("onnxscript", "export"): lambda path: onnx_model(torch.nn.Linear(3, 2), 3, {}),
    ("onnxruntime", ""): lambda path: open_session(path),
    ("yaml", "baselines"): described,
    ("yaml", "retarget"): lambda path: read_yaml(path, "map"),
    **{(name, "retarget"): lambda path: retarget(path) for name in ("mink", "daqp", "scipy")},
    **{(name, "studio"): page for name in ("mink", "daqp", "viser", "mjviser", "trimesh")},
    ("imageio", "video"): lambda path: check_video("film.mp4"),
    ("imageio_ffmpeg", "video"): lambda path: check_video("film.mp4"),
    ("matplotlib", "figures"): lambda path: pyplot(),
    ("huggingface_hub", "hub"): lambda path: plat.load("hf:a/b"),
    ("wandb", "wandb"): lambda path: check_logger("wandb"),
    ("trackio", "trackio"): lambda path: check_logger("trackio"),
    ("warp", "warp"): lambda path: check_physics("warp"),
    ("mujoco_warp", "warp"): lambda path: check_physics("warp"),
    ("ray", "ray"): lambda path: check_ray(),
    ("stable_baselines3", "sb3"): lambda path: importlib.import_module("plat.envs.sb3"),
}
"""What uses a package, by its name and the extra that is to be named; onnxruntime is named itself."""
WITH_ANOTHER = {"PIL": "imageio", "filelock": "torch", "glfw": "mujoco", "websockets": "viser"}
"""Packages that come with another one, without which they are not imported."""
IMPORTED_AT_ONCE = {
    "mink": "plat.motions.retargeting.inverse_kinematics",
    "daqp": "plat.motions.retargeting.inverse_kinematics",
    "scipy": "plat.motions.retargeting.planted_feet",
    "stable_baselines3": "plat.envs.sb3",
}
"""Modules, beside those of the studio, that cannot be imported without a package."""


@pytest.mark.parametrize(("package", "extra"), USES)
def test_a_package_that_is_not_installed(package, extra, tmp_path, monkeypatch):
    for name in list(sys.modules):
        if name.startswith(f"{package}."):
            monkeypatch.setitem(sys.modules, name, None)
        elif name in ("plat.studio", IMPORTED_AT_ONCE.get(package)) or name.startswith("plat.studio."):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delattr(plat, "studio", raising=False)  # put back with the modules: other tests patch them by name
    told = rf"'plat-rl\[{extra}\]'" if extra else package
    with pytest.raises((PlatError, ImportError), match=f"pip install {told}$") as raised:
        USES[package, extra](tmp_path / "a.onnx")
    assert "\n" not in str(raised.value)


def test_every_package_of_an_extra_is_hidden_above():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    always = {re.split(r"[^\w-]", one)[0].replace("-", "_") for one in project["dependencies"]}
    imported: set[str] = set()
    for path in ROOT.glob("plat/**/*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(str(node.module).partition(".")[0])
            elif isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                asked = node.args[2:] if called == "require" else node.args
                if called.endswith(("import_module", "find_spec", "require")):
                    imported |= {one.value.partition(".")[0] for one in asked if isinstance(one, ast.Constant)}
    optional = imported - always - set(sys.stdlib_module_names) - {"plat"}
    names = {package for package, _ in USES}
    assert optional - set(WITH_ANOTHER) <= names
    assert {"onnx", "ray", "viser"} <= optional


@pytest.mark.parametrize(
    "raised", [ImportError("libbroken.so.1: not found\nelsewhere"), ModuleNotFoundError("", name="json.no")]
)
def test_a_package_that_is_installed_and_broken_is_not_said_to_be_missing(raised):
    with (
        pytest.raises(RenderingError, match="^figures need packages of 'plat-rl.figures.', which are") as told,
        importing("figures", "figures need", RenderingError),
    ):
        raise raised
    assert str(told.value).endswith(("cannot be imported: libbroken.so.1: not found", "imported: ModuleNotFoundError"))


def test_what_is_not_about_imports_is_left_alone():
    with pytest.raises(KeyError), importing("figures", "figures need"):
        raise KeyError("a")
