"""Panels of the page: each turns user input into calls of the session, and shows the session's state.

All decisions are the session's.
"""

from plat.studio.panels.files import FilePanel
from plat.studio.panels.motion import MotionPanel
from plat.studio.panels.play import PlayPanel
from plat.studio.panels.pose import PosePanel
from plat.studio.panels.timeline_panel import TimelinePanel

__all__ = ["FilePanel", "MotionPanel", "PlayPanel", "PosePanel", "TimelinePanel"]
