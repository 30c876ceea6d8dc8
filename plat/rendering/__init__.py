"""Pictures, videos and a live view (OpenGL; extra ``plat-rl[video]``)."""

from plat.errors import RenderingError
from plat.rendering.films import Films
from plat.rendering.pictures import (
    Stage,
    check_video,
    contact_sheet,
    film,
    stage_model,
    stills,
    write_picture,
    write_video,
)
from plat.rendering.playback import Playback, play, record
from plat.rendering.strip import film_strip
from plat.rendering.viewer import Viewer

__all__ = [
    "Films",
    "Playback",
    "RenderingError",
    "Stage",
    "Viewer",
    "check_video",
    "contact_sheet",
    "film",
    "film_strip",
    "play",
    "record",
    "stage_model",
    "stills",
    "write_picture",
    "write_video",
]
