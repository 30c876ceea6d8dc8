"""Selects EGL for off-screen rendering on Linux machines without a display.

Import this before MuJoCo, which reads ``MUJOCO_GL`` when it is imported. A value that the user has set is kept, unless
MuJoCo could not be imported with it at all: where the library is missing, or for a renderer that there is not. Then
:data:`unusable` says so, and what draws raises an error with it.
"""

import ctypes
import os
import sys

_LIBRARIES = {"egl": ("libEGL.so.1",), "osmesa": ("libOSMesa.so", "libOSMesa.so.8", "libOSMesa.so.6")}
_PACKAGES = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
_OTHERS = ("", "glfw", "glx", "1", "on", "true", "enable", "enabled", "0", "off", "false", "disable", "disabled")

unusable: str | None = None
"""Why the renderer that ``MUJOCO_GL`` names was not taken; None where it was, or none was named."""


def _has(renderer: str) -> bool:
    for library in _LIBRARIES[renderer]:
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        return True
    return False


def _fault(renderer: str) -> str | None:
    """Return what is wrong with a value of ``MUJOCO_GL``."""
    if renderer in _LIBRARIES and not _has(renderer):
        return (
            f"MUJOCO_GL={renderer}: {_LIBRARIES[renderer][0]} is not installed "
            f"(on Debian or Ubuntu: apt install {_PACKAGES[renderer]})"
        )
    if renderer not in (*_LIBRARIES, *_OTHERS):
        return f"MUJOCO_GL={renderer!r}: no renderer of MuJoCo, expected egl, osmesa or glfw"
    return None


if sys.platform == "linux":
    unusable = _fault(os.environ.get("MUJOCO_GL", "").lower().strip())
    if unusable is not None:
        del os.environ["MUJOCO_GL"]
    if not {"DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"} & set(os.environ) and _has("egl"):
        os.environ["MUJOCO_GL"] = "egl"
