"""Pictures and videos of a robot (OpenGL; extra ``plat-rl[video]``)."""

from plat.errors import RenderingError
from plat.moved import moved_name
from plat.rendering.films import Films
from plat.rendering.pictures import (
    Stage,
    check_video,
    contact_sheet,
    film,
    film_with_progress,
    stage_model,
    stills,
    write_picture,
    write_video,
)
from plat.rendering.playback import Playback

__all__ = [
    "Films",
    "Playback",
    "RenderingError",
    "Stage",
    "check_video",
    "contact_sheet",
    "film",
    "film_with_progress",
    "stage_model",
    "stills",
    "write_picture",
    "write_video",
]


def __getattr__(name: str) -> object:
    return moved_name(__name__, name)
