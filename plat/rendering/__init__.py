"""Pictures, videos and a live view; needs OpenGL, and for files the extra ``plat-rl[video]``."""

from plat.rendering.pictures import (
    RenderingError,
    Stage,
    contact_sheet,
    film,
    stage_model,
    write_picture,
    write_video,
)
from plat.rendering.playback import Playback, play, record
from plat.rendering.viewer import Viewer

__all__ = [
    "Playback",
    "RenderingError",
    "Stage",
    "Viewer",
    "contact_sheet",
    "film",
    "play",
    "record",
    "stage_model",
    "write_picture",
    "write_video",
]
