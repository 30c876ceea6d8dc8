"""The parts of the page, one a module: each turns what users do into calls of the session, and shows the session.

Nothing is decided here; that is the session's.
"""

from plat.studio.panels.files import FilePanel
from plat.studio.panels.motion import MotionPanel
from plat.studio.panels.play import PlayPanel
from plat.studio.panels.pose import PosePanel
from plat.studio.panels.timeline import TimelinePanel

__all__ = ["FilePanel", "MotionPanel", "PlayPanel", "PosePanel", "TimelinePanel"]
