import errno
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from plat.envs.transforms import HORIZONS
from plat.errors import ConfigError, OutputError
from plat.evaluation import play
from plat.modules import Expert
from plat.motions import MotionLibrary
from plat.rendering import (
    RenderingError,
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
from plat.robots import G1
from tests.conftest import standing_clip


def test_a_description_may_have_a_sky_and_tiles_of_its_own(tmp_path):
    own = (
        '<texture name="sky" type="skybox" builtin="flat" width="8" height="8"/>'
        '<texture name="tiles" type="2d" builtin="flat" width="8" height="8"/><material name="tiles" texture="tiles"/>'
    )
    (tmp_path / "robot.xml").write_text(G1.asset_path.read_text().replace("<asset>", f"<asset>{own}"))
    model = stage_model(replace(G1, asset=str(tmp_path / "robot.xml")))
    assert model.ntex == stage_model(G1).ntex + 2


@pytest.fixture(scope="module")
def playback():
    library = MotionLibrary.from_clips([standing_clip()])
    return play(Expert(G1).deployed(), library, 0, HORIZONS["long"])


@pytest.fixture(scope="module")
def stage():
    try:
        stage = Stage(G1, width=160, height=120)
    except RenderingError as error:
        pytest.skip(str(error))
    yield stage
    stage.close()


def test_playback_follows_the_commands(playback):
    assert playback.qpos.shape == playback.target_qpos.shape == (len(playback.steps_left), 36)
    # countdowns: each command's steps are its length, one less each step, down to 1
    assert playback.steps_left[0] == playback.command_length[0]
    inside = (playback.steps_left[:-1] > 1) & ~playback.failed[:-1]
    assert (playback.steps_left[1:][inside] == playback.steps_left[:-1][inside] - 1).all()
    assert (np.diff(playback.target_qpos, axis=0)[inside] == 0).all()
    assert (playback.steps_left <= playback.command_length).all()


def test_playback_begins_on_the_reference(playback):
    library = MotionLibrary.from_clips([standing_clip()])
    first = library.poses(torch.tensor([0]))
    np.testing.assert_allclose(playback.qpos[0, 7:], first["joint_pos"][0], atol=1e-5)


def test_the_ghost_is_seen(stage, playback):
    alone = stage.draw(playback.qpos[0])
    moved = playback.qpos[0].copy()
    moved[1] += 0.5
    haunted = stage.draw(playback.qpos[0], moved)
    changed = (np.abs(alone.astype(int) - haunted).max(-1) > 20).mean()
    assert 0.01 < changed < 0.3
    # and it is green where it is
    new = np.abs(alone.astype(int) - haunted).max(-1) > 60
    assert haunted[new][:, 1].mean() > haunted[new][:, 0].mean()


def test_film_and_sheet(stage, playback, tmp_path):
    pictures = list(film(stage, playback, fps=5))
    assert len(pictures) == int(len(playback.qpos) * 0.02 * 5)
    assert pictures[0].shape == (120, 160, 3)
    sheet = contact_sheet(stage, [playback, playback], columns=3)
    assert sheet.shape == (2 * 60, 3 * 80, 3)
    write_picture(tmp_path / "sheet.png", sheet)
    write_video(tmp_path / "film.mp4", iter(pictures), fps=5)
    assert (tmp_path / "sheet.png").stat().st_size > 1000
    assert (tmp_path / "film.mp4").stat().st_size > 1000


def test_the_progress_of_a_film_counts_its_pictures(stage, playback, monkeypatch):
    told = []

    def tracked(items, what, total, unit):
        told.append((what, total, unit))
        return items

    monkeypatch.setattr("plat.rendering.pictures.tracked", tracked)
    pictures = list(film_with_progress(stage, [playback, playback], fps=3))
    assert told == [("video", len(pictures), "pictures")]
    np.testing.assert_array_equal(pictures[0], next(iter(film(stage, playback, fps=3))))


def test_a_picture_that_the_disk_does_not_take_is_one_line_and_leaves_the_one_before(tmp_path, monkeypatch):
    path = tmp_path / "sheet.png"
    write_picture(path, np.zeros((8, 8, 3), np.uint8))
    before = path.read_bytes()

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("imageio.v2.imwrite", full)
    with pytest.raises(RenderingError, match=r"sheet.png' could not be written \(No space left on device\)"):
        write_picture(path, np.ones((8, 8, 3), np.uint8))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_stills_show_the_first_and_the_last_frame_and_some_between(stage, playback):
    frames, pictures = stills(stage, playback.qpos, 3)
    last = len(playback.qpos) - 1
    assert frames.tolist() == [0, round(last / 2), last]
    for frame, picture in zip(frames, pictures, strict=True):
        stage.look_at(playback.qpos[frame])
        np.testing.assert_array_equal(picture, stage.draw(playback.qpos[frame]))
    assert (stills(stage, playback.qpos, 3, playback.target_qpos)[1] != pictures).any()


def test_the_bar_is_red_after_a_failure_though_no_time_is_left(stage, playback):
    failed = np.zeros(5, bool)
    failed[2] = True
    empty = replace(
        playback,
        qpos=playback.qpos[:5],
        target_qpos=playback.target_qpos[:5],
        steps_left=np.zeros(5, int),
        command_length=np.ones(5, int),
        failed=failed,
    )
    colors = [picture[-2, 80].astype(int) for picture in film(stage, empty, fps=50)]
    assert all(abs(red - green) < 30 for red, green, _ in colors[:2])
    assert all(red > green + 50 for red, green, _ in colors[2:])


def test_no_opengl_is_said_in_one_line(monkeypatch):
    def fail(*_):
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr("plat.rendering.pictures.mujoco.Renderer", fail)
    with pytest.raises(RenderingError, match="no OpenGL .*apt install libegl1 libgl1-mesa-dri"):
        Stage(G1)


def test_a_video_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(RenderingError, match=r"video 'film.gif': expected a file name that ends in .mp4"):
        write_video("film.gif", iter([]))
    (tmp_path / "film.mp4").mkdir()
    pictures = iter([np.zeros((64, 64, 3), np.uint8)] * 9)
    with pytest.raises(OutputError, match=r"film.mp4': is a folder, expected a file"):
        write_video(tmp_path / "film.mp4", pictures)


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(RenderingError, match=r"pip install 'plat-rl\[video\]'"):
        check_video("film.mp4")


def test_words_stand_at_the_bottom_of_each_picture_and_fit_it(stage, playback):
    words = ("",) * len(playback.qpos)
    plain = next(iter(film(stage, replace(playback, words=words))))
    line = "bow: late or off: 0.24 s late, 0.35 m off"
    told = next(iter(film(stage, replace(playback, words=(line, *words[1:])))))
    assert told.shape == plain.shape
    changed = (told != plain).any(-1)
    assert changed.any()
    assert not changed[: plain.shape[0] // 2].any()
    assert not changed[:, -3:].any()


def test_a_video_that_is_stopped_leaves_no_encoder_and_no_file(tmp_path):
    def stopped():
        yield np.zeros((16, 16, 3), np.uint8)
        raise KeyboardInterrupt

    error = None
    try:
        write_video(tmp_path / "half.mp4", stopped())
    except KeyboardInterrupt as caught:  # with its traceback, in which the encoder's writer lives on
        error = caught
    assert error is not None
    assert list(tmp_path.iterdir()) == []


def test_a_playback_of_one_step_has_a_picture(stage, playback, tmp_path):
    fields = ("qpos", "target_qpos", "steps_left", "command_length", "failed", "reached_qpos")
    step = replace(playback, **{name: getattr(playback, name)[:1] for name in fields})
    assert len(list(film(stage, step))) == 1


@pytest.mark.parametrize("setting", [{"width": 0}, {"height": 1.5}, {"distance": -1.0}])
def test_a_stage_of_no_size_is_refused(setting):
    (name,) = setting
    with pytest.raises(ConfigError, match=f"stage: {name}"):
        Stage(G1, **setting)


def test_a_pose_may_be_a_tensor_and_a_film_has_pictures(stage, playback):
    pose = playback.qpos[0]
    pictures = []
    for given in (pose, torch.from_numpy(pose)):
        stage.look_at(pose)
        pictures.append(stage.draw(given, given))
    np.testing.assert_array_equal(*pictures)
    with pytest.raises(ConfigError, match="film: fps is 0, expected a number above 0"):
        next(film(stage, playback, 0))
