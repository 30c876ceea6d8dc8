from types import SimpleNamespace

import numpy as np
import pytest
import torch

from plat.envs.transforms import HORIZONS
from plat.errors import MotionError
from plat.evaluation import play
from plat.modules import Expert
from plat.motions import MotionLibrary
from plat.rendering import Films, Playback, RenderingError
from plat.robots import G1
from tests.conftest import standing_clip


class Stage:
    """Draws nothing."""

    left_open = 0

    def __init__(self, robot, width, height):
        self.size = (height, width, 3)
        type(self).left_open += 1

    def look_at(self, position):
        pass

    def draw(self, qpos, ghost_qpos):
        return np.zeros(self.size, dtype=np.uint8)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        type(self).left_open -= 1


@pytest.fixture
def written(monkeypatch) -> list[tuple[str, int]]:
    """Name and number of pictures of every film."""
    films: list[tuple[str, int]] = []
    monkeypatch.setattr("plat.rendering.films.Stage", Stage)
    monkeypatch.setattr(
        "plat.rendering.films.write_video", lambda path, pictures, fps: films.append((path.name, len(list(pictures))))
    )
    return films


def playback() -> Playback:
    library = MotionLibrary.from_clips([standing_clip()])
    return play(Expert(G1).deployed(), library, 0, HORIZONS["long"])


def test_films_are_taken_when_they_are_due(tmp_path, written, monkeypatch):
    clock = SimpleNamespace(now=100.0, monotonic=lambda: clock.now)
    monkeypatch.setattr("plat.rendering.films.time", clock)
    films = Films(tmp_path, G1, playback, every=60.0, seconds=0.4, fps=5)
    clock.now = 159.9
    assert films.take(1) is None
    clock.now = 160.0
    assert films.take(2) == tmp_path / "2.mp4"
    clock.now = 219.9
    assert films.take(3) is None
    assert written == [("2.mp4", 2)]


def test_playing_draws_no_random_numbers(tmp_path, written):
    torch.manual_seed(0)
    films = Films(tmp_path, G1, playback, every=1e-9)
    expert = Expert(G1)  # playback makes one as well, which draws
    state = torch.random.get_rng_state()
    library = MotionLibrary.from_clips([standing_clip()])
    films = Films(tmp_path, G1, lambda: play(expert.deployed(), library, 0, HORIZONS["long"]), every=1e-9)
    assert films.take(1) is not None
    assert torch.equal(torch.random.get_rng_state(), state)


@pytest.mark.parametrize("error", [RenderingError("no OpenGL"), MotionError("motion 'blink': too short")])
def test_what_cannot_be_filmed_is_said_once_and_stops_nothing(tmp_path, written, capsys, error):
    def fail():
        raise error

    films = Films(tmp_path, G1, fail, every=1e-9)
    assert films.take(1) is None
    assert films.take(2) is None
    assert capsys.readouterr().out == f"no videos: {error}\n"
    assert Stage.left_open == 0


def test_no_films_on_request(tmp_path, written):
    assert Films(tmp_path, G1, playback, every=0.0).take(1) is None
    assert written == []
