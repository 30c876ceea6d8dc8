"""Every package can be the first one that a program imports."""

import pkgutil
import subprocess
import sys

import plat

# one process for all, which forgets plat between imports but not torch
PROGRAM = """
import importlib, sys, warnings

warnings.simplefilter("ignore")
for name in sys.argv[1:]:
    for module in [module for module in sys.modules if module.split(".")[0] == "plat"]:
        del sys.modules[module]
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name.split(".")[0] == "plat":  # an extra that is not installed is another matter
            sys.exit(f"{name}: {error}")
    except ImportError as error:
        sys.exit(f"{name}: {error}")
"""


def test_no_package_needs_another_one_imported_before_it():
    packages = [f"plat.{module.name}" for module in pkgutil.iter_modules(plat.__path__) if module.ispkg]
    assert {"plat.envs", "plat.rendering", "plat.runs"} <= set(packages)
    out = subprocess.run([sys.executable, "-c", PROGRAM, *packages], capture_output=True, text=True, check=False)
    assert out.returncode == 0, out.stderr
