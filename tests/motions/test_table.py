import torch

from plat.motions import MotionClip, MotionLibrary
from plat.motions.table import FIELDS, TableBuilder, table_width
from plat.robots import G1
from tests.conftest import standing_clip


def clips() -> list[MotionClip]:
    moving = [standing_clip(f"clip {number}", 31 + 7 * number) for number in range(6)]
    for number, clip in enumerate(moving):
        clip.qpos[:, 7 + number] += torch.linspace(0, 0.3, len(clip.qpos)).square().numpy()
    return moving


def test_the_size_of_chunks_changes_nothing(monkeypatch):
    whole = MotionLibrary.from_clips(clips())
    for size in (1, 50, len(whole) - 1, len(whole)):
        monkeypatch.setattr("plat.motions.table._CHUNK", size)
        parts = MotionLibrary.from_clips(clips())
        torch.testing.assert_close(parts.frames, whole.frames, rtol=0, atol=2e-5)
        assert parts.clip_start.equal(whole.clip_start)
        assert parts.clip_names == whole.clip_names


def test_rows_are_written_as_clips_come(monkeypatch):
    monkeypatch.setattr("plat.motions.table._CHUNK", 40)
    written: list[int] = []
    builder = TableBuilder(G1, 0.02, lambda rows: written.append(len(rows)))
    for number in range(4):
        builder.add(standing_clip("a", 51, 50.0))
        assert 51 * (number + 1) - sum(written) < 3 * 40
    _, length = builder.finish()
    assert written == [40] * 5 + [4]
    assert length.tolist() == [51] * 4


def test_width_of_rows():
    assert table_width(FIELDS, G1) == 2 * 29 + 14 * (3 + 4 + 3 + 3)
