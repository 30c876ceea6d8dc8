import bz2
import gzip
import lzma
import zlib

import pytest

from plat.errors import MotionError
from plat.motions.formats.decompress import check_numbers, decompress, size_limit

COMPRESSORS = {
    "zlib": zlib.compress,
    "gzip": gzip.compress,
    "bz2": bz2.compress,
    "xz": lzma.compress,
    "lzma": lambda data: lzma.compress(data, format=lzma.FORMAT_ALONE),
}


@pytest.mark.parametrize("name", COMPRESSORS)
def test_what_went_in_comes_out(name):
    data = bytes(range(256)) * 50
    assert decompress(COMPRESSORS[name](data)) == data


def test_what_is_not_compressed_stays():
    assert decompress(b"\x80\x04K\x01.") == b"\x80\x04K\x01."
    assert decompress(b"") == b""


@pytest.mark.parametrize("name", COMPRESSORS)
def test_a_bomb_is_refused(name, monkeypatch):
    monkeypatch.setattr("plat.motions.formats.decompress._GENEROUS", 1 << 20)
    bomb = COMPRESSORS[name](bytes(2 << 20))
    assert len(bomb) < 10_000
    if name in ("xz", "lzma"):  # they ask for a large dictionary, which is refused first
        with pytest.raises((MotionError, lzma.LZMAError)):
            decompress(bomb)
        return
    with pytest.raises(MotionError, match=f"more than {1 << 20} bytes"):
        decompress(bomb)


@pytest.mark.parametrize("name", ["zlib", "gzip", "bz2", "xz"])
def test_a_stream_cut_short_is_refused(name):
    with pytest.raises(MotionError, match="ends too early"):
        decompress(COMPRESSORS[name](bytes(range(256)) * 50)[:-5])


def test_lz4_is_named():
    with pytest.raises(MotionError, match="lz4"):
        decompress(b"\x04\x22\x4d\x18....")


def test_limits_grow_with_the_file():
    assert size_limit(10) == size_limit(1000)
    assert size_limit(1 << 30) == 20 << 30


def test_real_data_sets_hold_fewer_numbers_than_are_believed():
    for frames, clips in ((120 * 3600, 1), (300, 10_000)):
        numbers = 36 * frames * clips
        check_numbers(numbers, compressed=numbers)  # float32, a quarter of its size
        with pytest.raises(MotionError, match=r"it unpacks to \d+ million numbers, expected motions"):
            check_numbers(numbers, compressed=numbers // 20)
