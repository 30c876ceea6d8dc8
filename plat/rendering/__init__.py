"""Pictures, videos and a live view (OpenGL; extra ``plat-rl[video]``), and figures (``plat-rl[figures]``)."""

from plat.rendering.figures import pyplot
from plat.rendering.pictures import (
    RenderingError,
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
from plat.rendering.viewer import Viewer

__all__ = [
    "Playback",
    "RenderingError",
    "Stage",
    "Viewer",
    "check_video",
    "contact_sheet",
    "film",
    "play",
    "pyplot",
    "record",
    "stage_model",
    "stills",
    "write_picture",
    "write_video",
]
