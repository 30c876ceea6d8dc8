"""Pictures and videos of a robot that chases keyframes, the commanded pose drawn as a ghost."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import mujoco
import numpy as np

from plat.bounds import Count, Positive, check_robot, check_value
from plat.errors import RenderingError, StateError
from plat.extras import importing
from plat.files import as_path, check_file, is_full, replace_file
from plat.headless import unusable
from plat.progress import tracked
from plat.rendering.mp4 import is_whole
from plat.rendering.playback import Playback
from plat.robots.contact_geoms import visual_groups
from plat.robots.robot import Robot

__all__ = [
    "Stage",
    "add_ghost",
    "check_video",
    "contact_sheet",
    "film",
    "film_with_progress",
    "show_visible",
    "stage_model",
    "stills",
    "write_picture",
    "write_video",
]

_GHOST = np.array([0.1, 0.75, 0.45, 0.35])
_SKY_TOP, _SKY_BOTTOM = [0.55, 0.66, 0.78], [0.93, 0.95, 0.97]
_TILE_DARK, _TILE_LIGHT = [0.30, 0.34, 0.38], [0.35, 0.39, 0.43]
_OURS = "plat"  # begins the names of what is added: descriptions have a sky or tiles of their own


class Stage:
    """Renderer of a robot and a translucent ghost of it, with a camera that follows.

    Use it as a context, or close it: its OpenGL context holds a hundred megabytes where there is no GPU.

    Args:
        robot: the robot.
        width, height: of a picture (pixels).
        distance: of the camera (m); 2.6 shows raised hands and jumps whole.

    Raises:
        ConfigError: for a size or a distance that is not above 0.
        RenderingError: where no OpenGL is available, with what to install.
    """

    def __init__(self, robot: Robot, width: int = 640, height: int = 480, distance: float = 2.1):
        for name, number, bound in (
            ("width", width, Count),
            ("height", height, Count),
            ("distance", distance, Positive),
        ):
            check_value(f"stage: {name}", number, bound)
        check_robot(robot)
        _check_display()
        self._model = stage_model(robot, width, height)
        self._data, self._ghost = mujoco.MjData(self._model), mujoco.MjData(self._model)
        try:
            self._renderer = mujoco.Renderer(self._model, height, width)
        except Exception as error:  # each OpenGL backend raises its own kind
            raise RenderingError(
                f"no OpenGL ({type(error).__name__}: {error}); on Debian or Ubuntu: apt install libegl1 "
                "libgl1-mesa-dri, then set MUJOCO_GL=egl"
            ) from error
        self._options = mujoco.MjvOption()
        show_visible(self._options, self._model)
        self._camera = mujoco.MjvCamera()
        self._camera.distance, self._camera.azimuth, self._camera.elevation = distance, 125.0, -10.0
        self._camera.lookat[2] = 0.68

    def draw(self, qpos: np.ndarray, ghost_qpos: np.ndarray | None = None) -> np.ndarray:
        """Return a picture ``[height, width, 3]`` of a pose ``[7 + J]`` and a ghost.

        Raises:
            StateError: for a pose of another robot.
        """
        for name, pose in (("qpos", qpos), ("ghost_qpos", ghost_qpos)):
            if pose is not None and np.shape(pose) != self._data.qpos.shape:
                raise StateError(f"stage: {name} has shape {np.shape(pose)}, expected {self._data.qpos.shape}")
        qpos = np.asarray(qpos)  # NumPy does no arithmetic with tensors
        self._data.qpos[:] = qpos
        mujoco.mj_forward(self._model, self._data)
        # follow the robot slowly, so that its own motion shows
        self._camera.lookat[:2] += 0.1 * (qpos[:2] - self._camera.lookat[:2])
        self._renderer.update_scene(self._data, self._camera, self._options)
        if ghost_qpos is not None:
            add_ghost(self._renderer.scene, self._model, self._ghost, self._options, ghost_qpos)
        return self._renderer.render()

    def look_at(self, position: np.ndarray) -> None:
        """Aim the camera at a point of the floor at once."""
        self._camera.lookat[:2] = position[:2]

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.close()

    def __enter__(self) -> "Stage":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _check_display() -> None:
    if unusable is not None:
        raise RenderingError(unusable)
    # GLFW's second failure to open a window ends the whole program
    windowed = getattr(mujoco, "GLContext", object).__module__ == "mujoco.glfw"
    if windowed and sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
        raise RenderingError(
            "no display, and MuJoCo was imported with a renderer that needs one: set MUJOCO_GL=egl before Python "
            "starts (on Debian or Ubuntu: apt install libegl1 libgl1-mesa-dri)"
        )


def show_visible(options: mujoco.MjvOption, model: mujoco.MjModel) -> None:
    """Show floor and visual geoms of a model, and hide collision geoms where it has others."""
    options.geomgroup[:] = 0
    options.geomgroup[[0, *visual_groups(model)]] = 1


def add_ghost(
    scene: mujoco.MjvScene, model: mujoco.MjModel, data: mujoco.MjData, options: mujoco.MjvOption, qpos: np.ndarray
) -> None:
    """Add a robot in a pose ``[7 + J]`` to a scene, translucent; ``data`` is scratch space."""
    before = scene.ngeom
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mjv_addGeoms(model, data, options, mujoco.MjvPerturb(), mujoco.mjtCatBit.mjCAT_DYNAMIC, scene)
    for geom in scene.geoms[before : scene.ngeom]:
        geom.rgba[:] = _GHOST
        geom.matid = -1


def film(stage: Stage, playback: Playback, fps: float = 25.0) -> Iterator[np.ndarray]:
    """Yield pictures of a playback, with its words, and a bar of the time left that turns red when a command fails."""
    check_value("film: fps", fps, Positive)
    stage.look_at(playback.qpos[0])
    failed_until = -1
    for step in _steps(playback, fps):
        span = range(step, min(len(playback.qpos), step + max(1, round(1 / (fps * playback.dt)))))
        if any(playback.failed[index] for index in span):
            failed_until = step + round(0.5 / playback.dt)
        picture = stage.draw(playback.qpos[step], playback.target_qpos[step]).copy()
        fraction = playback.steps_left[step] / max(playback.command_length[step], 1)
        _bar(picture, fraction, failed=step < failed_until)
        yield _titled(picture, playback.words[step]) if playback.words else picture


def film_with_progress(stage: Stage, playbacks: Sequence[Playback], fps: float = 25.0) -> Iterator[np.ndarray]:
    """Yield pictures of playbacks, one after the other, with a progress bar on standard error."""
    pictures = (picture for playback in playbacks for picture in film(stage, playback, fps))
    return tracked(pictures, "video", sum(_count(playback, fps) for playback in playbacks), "pictures")


def stills(
    stage: Stage, qpos: np.ndarray, count: int, ghost_qpos: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return pictures from a motion, evenly spaced in time, each centered on the robot.

    Args:
        stage: draws them.
        qpos: the motion ``[T, 7 + J]``.
        count: number of pictures N.
        ghost_qpos: pose of the ghost in every frame ``[T, 7 + J]``.

    Returns:
        The frames that are shown ``[N]`` and the pictures ``[N, height, width, 3]``.
    """
    check_value("stills: count", count, Count)
    frames = np.linspace(0, len(qpos) - 1, count).round().astype(int)
    pictures = []
    for frame in frames:
        stage.look_at(qpos[frame])
        pictures.append(stage.draw(qpos[frame], None if ghost_qpos is None else ghost_qpos[frame]))
    return frames, np.stack(pictures)


def contact_sheet(stage: Stage, playbacks: Sequence[Playback], columns: int = 6) -> np.ndarray:
    """Return one row of pictures for each playback, evenly spaced in time: ``[rows * height, columns * width, 3]``."""
    rows = []
    for playback in playbacks:
        _, pictures = stills(stage, playback.qpos, columns, playback.target_qpos)
        rows.append(np.concatenate(pictures[:, ::2, ::2], 1))
    return np.concatenate(rows, 0)


def check_video(path: str | Path) -> None:
    """Check that a video can be written, before there is one.

    Raises:
        RenderingError: when the extra ``plat-rl[video]`` is not installed, or the file is no ``.mp4``.
        OutputError: when its folder cannot be written to.
    """
    _imageio()
    if as_path(path, "video", RenderingError).suffix != ".mp4":
        raise RenderingError(f"video {str(path)!r}: expected a file name that ends in .mp4")
    check_file(Path(path), "video")


def write_video(path: str | Path, pictures: Iterator[np.ndarray], fps: float = 25.0) -> None:
    """Write an MP4; the file is replaced in one step or not at all.

    Raises:
        RenderingError: as :func:`check_video` does, and when the disk does not take it.
    """
    check_video(path)
    check_value("video: fps", fps, Positive)
    imageio = _imageio()

    path = Path(path)

    def encode(part: Path) -> None:
        # the encoder's own words would come between plat's
        options = {"codec": "libx264", "quality": 7, "macro_block_size": 8, "ffmpeg_log_level": "quiet"}
        writer = imageio.get_writer(part, fps=fps, **options)
        try:
            for picture in pictures:
                writer.append_data(picture)
        except BaseException:
            # as a context it would be left open here: the encoder went on, and wrote the file once more
            with suppress(Exception):
                writer.close()
            raise
        writer.close()
        if not is_whole(part):  # the encoder's exit status is not told
            raise OSError("the encoder stopped early")

    def write(part: Path) -> None:
        try:
            encode(part)
        except OSError as error:
            if is_full(part.parent):  # asked while the half is there: without it there is room again
                raise OSError("no space left on device") from error
            raise

    try:
        replace_file(path, write)
    except OSError as error:
        reason = error.strerror or str(error).splitlines()[0]  # the encoder's whole command line follows
        raise RenderingError(f"video {str(path)!r} could not be written ({reason})") from error


def write_picture(path: str | Path, picture: np.ndarray) -> None:
    """Write a PNG; the file is replaced in one step or not at all.

    Raises:
        RenderingError: when the extra ``plat-rl[video]`` is not installed, the file is no ``.png``, or the disk does
            not take it.
    """
    imageio = _imageio()
    if as_path(path, "picture", RenderingError).suffix.lower() != ".png":
        raise RenderingError(f"picture {str(path)!r}: expected a file name that ends in .png")
    try:
        replace_file(Path(path), lambda part: imageio.imwrite(part, picture))
    except OSError as error:
        raise RenderingError(f"picture {str(path)!r} could not be written ({error.strerror or error})") from error


def _imageio() -> Any:
    with importing("video", "pictures and videos need", RenderingError):
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401  (the encoder that imageio looks for)
    # imageio_ffmpeg would fork this whole process to start its encoder: it can hang beside threads, and fails where
    # memory is scarce.
    os.environ.setdefault("IMAGEIO_FFMPEG_NO_PREVENT_SIGINT", "1")
    return imageio


def _steps(playback: Playback, fps: float) -> Iterator[int]:
    last = len(playback.qpos) - 1
    return (min(round(index / (fps * playback.dt)), last) for index in range(_count(playback, fps)))


def _count(playback: Playback, fps: float) -> int:
    return max(1, int(len(playback.qpos) * playback.dt * fps))  # a step alone has a picture too


def _bar(picture: np.ndarray, fraction: float, failed: bool) -> None:
    height, width = picture.shape[:2]
    top, bottom = height - height // 40, height - height // 120
    picture[top:bottom] = (120, 40, 35) if failed else (picture[top:bottom] * 0.6).astype(np.uint8)
    picture[top:bottom, : round(fraction * width)] = (220, 70, 60) if failed else (40, 190, 130)


def _titled(picture: np.ndarray, words: str) -> np.ndarray:
    """Return a picture with a line of text at its bottom, above the bar."""
    if not words:
        return picture
    from PIL import Image, ImageDraw  # comes with imageio, which writes the pictures

    height, width = picture.shape[:2]
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    left, top, right, bottom = draw.textbbox((0, 0), words)
    # Pillow's own font has one size: the line is drawn small, then enlarged
    line = Image.new("L", (int(right - left) + 8, int(bottom - top) + 6), 0)
    ImageDraw.Draw(line).text((4 - left, 3 - top), words, fill=255)
    scale = min(height / 240, 0.96 * width / line.width)
    line = line.resize((max(1, int(line.width * scale)), max(1, int(line.height * scale))), Image.Resampling.BICUBIC)
    corner = (width // 50, height - height // 30 - line.height)
    image.paste((35, 40, 45), (*corner, corner[0] + line.width, corner[1] + line.height))
    image.paste((255, 255, 255), corner, line)
    return np.asarray(image)


def stage_model(robot: Robot, width: int = 640, height: int = 480) -> mujoco.MjModel:
    """Return the robot's model with sky, tiles and light; its dynamics are those of the plain model.

    Args:
        robot: the robot.
        width, height: of the largest picture (pixels).
    """
    spec = robot.spec()
    spec.add_texture(
        name=f"{_OURS} sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=_SKY_BOTTOM,
        rgb2=_SKY_TOP,
        width=128,
        height=768,
    )
    spec.add_texture(
        name=f"{_OURS} tiles",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=_TILE_DARK,
        rgb2=_TILE_LIGHT,
        width=256,
        height=256,
    )
    tiles = spec.add_material(name=f"{_OURS} tiles", texrepeat=[1, 1], texuniform=True, reflectance=0.05)
    tiles.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = f"{_OURS} tiles"
    floor = spec.geom("floor")
    floor.material, floor.group = f"{_OURS} tiles", 0
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[2, -2, 4],
        dir=[-0.4, 0.4, -1],
        diffuse=[0.6, 0.6, 0.6],
        castshadow=True,
    )
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.4, 0.4, 0.4]
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    return spec.compile()
