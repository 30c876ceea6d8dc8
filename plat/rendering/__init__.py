"""Pictures, videos and a live view (OpenGL; extra ``plat-rl[video]``), and figures (``plat-rl[figures]``)."""

from plat.rendering.bars import ablation_bars
from plat.rendering.figures import pyplot
from plat.rendering.films import Films
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
from plat.rendering.radar import radar_plot
from plat.rendering.strip import film_strip
from plat.rendering.style import save_figure
from plat.rendering.success import success_plot
from plat.rendering.viewer import Viewer

__all__ = [
    "Films",
    "Playback",
    "RenderingError",
    "Stage",
    "Viewer",
    "ablation_bars",
    "check_video",
    "contact_sheet",
    "film",
    "film_strip",
    "play",
    "pyplot",
    "radar_plot",
    "record",
    "save_figure",
    "stage_model",
    "stills",
    "success_plot",
    "write_picture",
    "write_video",
]
