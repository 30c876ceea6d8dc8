import ctypes
import importlib
import os
import re
import subprocess
import sys

import pytest

import plat.headless


@pytest.mark.parametrize(
    ("platform", "before", "after"),
    [
        ("linux", {}, {"MUJOCO_GL": "egl"}),
        ("linux", {"MUJOCO_GL": "osmesa"}, {"MUJOCO_GL": "osmesa"}),
        ("linux", {"DISPLAY": ":0"}, {"DISPLAY": ":0"}),
        ("linux", {"WAYLAND_DISPLAY": "wayland-0"}, {"WAYLAND_DISPLAY": "wayland-0"}),
        ("darwin", {}, {}),
    ],
)
def test_egl_is_chosen_only_where_nothing_else_is(monkeypatch, platform, before, after):
    environment = dict(before)
    monkeypatch.setattr(ctypes, "CDLL", str)
    monkeypatch.setattr(os, "environ", environment)
    monkeypatch.setattr(sys, "platform", platform)
    importlib.reload(plat.headless)
    assert environment == after


def test_it_comes_before_mujoco():
    code = "import sys, plat.headless; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("first", ["plat", "plat.robots", "plat.motions.library", "plat.control.simulator"])
def test_whichever_part_of_plat_comes_first_it_came_before(first):
    # what sees MuJoCo come looks whether the renderer was chosen by then
    code = f"""
import importlib.abc, sys
class Watch(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == "mujoco" and "plat.headless" not in sys.modules:
            raise SystemExit("MuJoCo comes first")
sys.meta_path.insert(0, Watch())
import {first}
sys.exit("plat.headless" not in sys.modules)
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_without_the_library_nothing_is_set_and_mujoco_can_still_be_imported(monkeypatch):
    def missing(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", missing)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(os, "environ", environment := {})
    importlib.reload(plat.headless)
    assert environment == {}


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("osmesa", "MUJOCO_GL=osmesa: libOSMesa.so is not installed .*apt install libosmesa6"),
        ("EGL", "MUJOCO_GL=egl: libEGL.so.1 is not installed"),
        ("vulkan", "MUJOCO_GL='vulkan': no renderer of MuJoCo, expected egl, osmesa or glfw"),
    ],
)
def test_a_renderer_that_is_not_there_stops_only_what_draws(value, message):
    program = f"""
import ctypes, os
os.environ["MUJOCO_GL"] = {value!r}
def missing(name): raise OSError(name)
ctypes.CDLL, real = missing, ctypes.CDLL
import plat.headless
ctypes.CDLL = real
from plat.rendering import Stage
from plat.robots import G1
print(os.environ.get("MUJOCO_GL"))
Stage(G1)
"""
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert out.stdout == "None\n"
    assert re.search(f"RenderingError: {message}", out.stderr.splitlines()[-1])
