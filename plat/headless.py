"""Selects EGL for off-screen rendering on Linux machines without a display.

Import this before MuJoCo, which reads ``MUJOCO_GL`` when it is imported. A value that the user has set is kept. Where
the EGL library is missing nothing is set, because MuJoCo could then not be imported at all.
"""

import ctypes
import os
import sys


def _has_egl() -> bool:
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    return True


if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"} & set(os.environ) and _has_egl():
    os.environ["MUJOCO_GL"] = "egl"
