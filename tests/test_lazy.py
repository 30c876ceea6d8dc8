"""Packages import their names on use, and nothing else about them differs."""

import importlib
import subprocess
import sys
from types import ModuleType

import pytest

import plat.evaluation
import plat.modules
import plat.objectives

PACKAGES = ["plat.envs", "plat.envs.transforms", "plat.modules", "plat.motions", "plat.objectives", "plat.runs"]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there(package):
    module = importlib.import_module(package)
    assert set(module.__all__) <= set(dir(module))
    names: dict[str, object] = {}
    exec(f"from {package} import *", names)
    assert set(module.__all__) <= set(names)


def test_a_submodule_does_not_take_the_name_of_a_function():
    importlib.import_module("plat.objectives.motor_gradient")
    importlib.import_module("plat.evaluation.report")
    assert not isinstance(plat.objectives.motor_gradient, ModuleType)
    assert not isinstance(plat.evaluation.report, ModuleType)


def test_submodules_are_attributes_without_an_import_of_their_own():
    program = "import plat.modules; plat.modules.heads.GaussianNoise"
    subprocess.run([sys.executable, "-W", "ignore", "-c", program], check=True)


def test_another_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'plat.modules' has no attribute 'Expret'"):
        plat.modules.Expret  # noqa: B018
    assert not hasattr(plat.modules, "_private")


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_a_package_loads_no_torch(package):
    program = f"import sys, {package}; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True)
