"""Pictures and videos; needs OpenGL and the extra ``plat-rl[video]``."""

from plat.rendering.pictures import RenderingError, Stage, contact_sheet, film, write_picture, write_video
from plat.rendering.playback import Playback, play

__all__ = ["Playback", "RenderingError", "Stage", "contact_sheet", "film", "play", "write_picture", "write_video"]
