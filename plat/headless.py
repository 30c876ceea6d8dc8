"""Import this before MuJoCo is imported, and pictures can be drawn on a machine without a screen.

MuJoCo chooses its OpenGL by ``MUJOCO_GL`` when it is imported; without a screen only EGL (or OSMesa) draws. What the
user has set stays.
"""

import os
import sys

if sys.platform == "linux" and "DISPLAY" not in os.environ:
    os.environ.setdefault("MUJOCO_GL", "egl")
