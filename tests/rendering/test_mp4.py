import numpy as np
import pytest

from plat.errors import RenderingError
from plat.rendering import write_video
from plat.rendering.mp4 import is_whole

PICTURES = np.random.default_rng(0).integers(0, 255, (9, 64, 64, 3), np.uint8)


def box(kind, content=b"", long=False):
    if long:
        return (1).to_bytes(4, "big") + kind + (16 + len(content)).to_bytes(8, "big") + content
    return (8 + len(content)).to_bytes(4, "big") + kind + content


WHOLE = box(b"ftyp", b"isom") + box(b"mdat", b"pictures", long=True) + box(b"moov", b"index")


@pytest.mark.parametrize(
    ("content", "whole"),
    [
        (WHOLE, True),
        (box(b"ftyp") + box(b"moov") + (0).to_bytes(4, "big") + b"mdat to the end", True),
        (WHOLE[:-1], False),
        (WHOLE[:-13], False),
        (WHOLE + b"\0", False),
        (WHOLE + b"\0\0\0\7free", False),
        (box(b"ftyp") + box(b"moov"), False),
        (b"", False),
    ],
)
def test_boxes(tmp_path, content, whole):
    path = tmp_path / "a.mp4"
    path.write_bytes(content)
    assert is_whole(path) == whole


def test_a_video_that_the_encoder_did_not_finish_is_an_error(tmp_path, monkeypatch):
    path = tmp_path / "film.mp4"
    write_video(path, iter(PICTURES))
    before = path.read_bytes()
    assert is_whole(path)
    assert not list(tmp_path.glob(".*"))

    monkeypatch.setattr(
        "plat.rendering.pictures.is_whole", lambda part: part.write_bytes(before[:-100]) and is_whole(part)
    )
    with pytest.raises(RenderingError, match=r"film.mp4' could not be written \(the encoder stopped early\)"):
        write_video(path, iter(PICTURES))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_named_though_the_half_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr("plat.rendering.pictures.is_whole", lambda _: False)
    monkeypatch.setattr("plat.rendering.pictures.is_full", lambda folder: any(folder.iterdir()))
    with pytest.raises(RenderingError, match=r"film.mp4' could not be written \(no space left on device\)"):
        write_video(tmp_path / "film.mp4", iter(PICTURES))
    assert not list(tmp_path.iterdir())
