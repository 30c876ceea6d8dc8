import importlib
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from plat.moved import MOVED, MOVED_NAMES


@pytest.mark.parametrize("old", sorted(MOVED))
def test_old_paths_are_the_new_modules_and_warn(old: str) -> None:
    new = importlib.import_module(MOVED[old])
    own_name = new.__spec__.name
    for name in [name for name in sys.modules if name == old or name.startswith(f"{old}.")]:
        del sys.modules[name]
    with pytest.warns(FutureWarning, match=f"{old} is now {MOVED[old]}"):
        alias = importlib.import_module(old)
    assert alias is new
    assert new.__spec__.name == own_name == MOVED[old]


@pytest.mark.parametrize(
    ("old", "new", "version"),
    [
        ("plat.motions.retargeting.solver", "plat.motions.retargeting.inverse_kinematics", "0.4"),
        ("plat.envs.motions.retargeting.solver", "plat.motions.retargeting.inverse_kinematics", "0.3"),
        ("plat.envs.motions.formats.table", "plat.motions.formats.text_tables", "0.3"),
    ],
)
def test_one_warning_says_where_a_module_is_and_until_when(old: str, new: str, version: str) -> None:
    sys.modules.pop(old, None)
    with pytest.warns(FutureWarning) as warned:
        alias = importlib.import_module(old)
    # packages above it have warnings of their own
    assert [str(one.message) for one in warned if new in str(one.message)] == [
        f"{old} is now {new}; the old name is removed in version {version}"
    ]
    assert alias is importlib.import_module(new)


OF_0_2 = dict(
    line.partition(": ")[::2] for line in Path(__file__).with_name("names_of_0_2.txt").read_text().splitlines()
)
"""Names that packages of 0.2.0 exported, by the package; modules, which export none here, are listed as well."""


@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_modules_of_the_version_before_can_be_imported() -> None:
    assert len(OF_0_2) > 200
    assert [name for name in OF_0_2 if find_spec(name) is None] == []


@pytest.mark.filterwarnings("ignore::FutureWarning")
@pytest.mark.parametrize("package", [package for package, names in OF_0_2.items() if names])
def test_names_of_the_version_before_are_where_they_were(package: str) -> None:
    module = importlib.import_module(package)
    assert [name for name in OF_0_2[package].split() if not hasattr(module, name)] == []


def test_submodules_are_not_run_again() -> None:
    import plat.runs.budget

    with pytest.warns(FutureWarning, match=r"plat\.training\.budget is now"):
        alias = importlib.import_module("plat.training.budget")
    assert alias is plat.runs.budget
    assert alias.__spec__.name == "plat.runs.budget"


def test_names_that_moved_out_of_envs_warn() -> None:
    import plat.envs
    import plat.motions
    import plat.robots

    with pytest.warns(FutureWarning, match=r"plat\.robots\.G1"):
        assert plat.envs.G1 is plat.robots.G1
    with pytest.warns(FutureWarning, match=r"plat\.motions\.MotionLibrary"):
        assert plat.envs.MotionLibrary is plat.motions.MotionLibrary
    with pytest.raises(AttributeError, match="split into TrackingTaskConfig, DistillationTaskConfig and Keyframe"):
        plat.envs.TaskConfig  # noqa: B018
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        plat.envs.Nothing  # noqa: B018


@pytest.mark.parametrize(
    ("package", "name"), [(package, name) for package in MOVED_NAMES for name in MOVED_NAMES[package]]
)
def test_names_that_moved_to_another_package_warn(package: str, name: str) -> None:
    new = MOVED_NAMES[package][name]
    with pytest.warns(FutureWarning, match=f"{package}.{name} is now {new}.{name}"):
        assert getattr(importlib.import_module(package), name) is getattr(importlib.import_module(new), name)


def test_a_name_that_never_was() -> None:
    with pytest.raises(AttributeError, match="'plat.rendering' has no attribute 'Nothing'"):
        importlib.import_module("plat.rendering").Nothing  # noqa: B018


def test_motions_load_no_torchrl() -> None:
    code = "import sys, plat.motions, plat.robots; print([name for name in sys.modules if name.startswith('torchrl')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
