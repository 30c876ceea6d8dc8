"""Selects EGL for off-screen rendering on Linux machines without a display.

Import this before MuJoCo, which reads ``MUJOCO_GL`` when it is imported. A value that the user has set is kept.
"""

import os
import sys

if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
    os.environ.setdefault("MUJOCO_GL", "egl")
