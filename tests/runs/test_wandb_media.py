from types import SimpleNamespace

import numpy as np
import pytest

from plat.evaluation import METRICS
from plat.runs import log_scores, log_video
from tests.rendering.scores import made_up

wandb = pytest.importorskip("wandb")


class Log:
    """A run that keeps what is logged."""

    def __init__(self):
        self.entries: list[tuple[dict, int | None]] = []

    def log(self, entry, step=None):
        self.entries.append((entry, step))


def test_the_table_has_a_row_a_figure(tmp_path):
    log, scores = Log(), made_up("DAgger", "PLAT")
    picture = tmp_path / "radar.png"
    pytest.importorskip("imageio").imwrite(picture, np.zeros((4, 4, 3), dtype=np.uint8))
    log_scores(log, scores, [picture, tmp_path / "radar.pdf"])
    ((entry, _),) = log.entries
    table = entry["evaluation"]
    assert table.columns == ["policy", "horizon", "seeds", "metric", "value", "low", "high"]
    assert len(table.data) == len(scores) * len(METRICS)
    tks = next(score for score in scores if (score.policy, score.horizon) == ("PLAT", "mixed")).figures["tks"]
    assert ["PLAT", "mixed", 1, "tks", tks.value, tks.low, tks.high] in table.data
    assert [name for name in entry if name != "evaluation"] == ["figures/radar"]


def test_a_video_is_logged_at_its_step(tmp_path, monkeypatch):
    monkeypatch.setattr(wandb, "Video", lambda path, format: SimpleNamespace(path=path, format=format))
    log = Log()
    log_video(log, tmp_path / "7.mp4", 7)
    ((entry, step),) = log.entries
    assert step == 7
    assert (entry["video"].path, entry["video"].format) == (str(tmp_path / "7.mp4"), "mp4")
