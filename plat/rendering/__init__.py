"""Pictures and videos (OpenGL and the extra ``plat-rl[video]``) and figures (``plat-rl[figures]``)."""

from plat.rendering.figures import pyplot
from plat.rendering.pictures import RenderingError, Stage, contact_sheet, film, stills, write_picture, write_video
from plat.rendering.playback import Playback, play

__all__ = [
    "Playback",
    "RenderingError",
    "Stage",
    "contact_sheet",
    "film",
    "play",
    "pyplot",
    "stills",
    "write_picture",
    "write_video",
]
