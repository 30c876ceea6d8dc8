import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import large_library
from large_library import LargeLibraryConfig, main, make_up, opened


def test_made_up_clips_are_a_library(tmp_path):
    make_up(tmp_path / "table.safetensors", clips=50, hours=0.01)
    library = opened(tmp_path / "table.safetensors")
    assert library.num_clips == 50
    assert len(library) == 50 * 36


def test_every_figure_is_printed_and_nothing_is_left(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(large_library, "_SECONDS", 1000)
    main(LargeLibraryConfig(clips=50, hours=0.01, folder=tmp_path))
    lines = capsys.readouterr().out.splitlines()[1:]
    assert len(lines) == 8
    assert all(float(line.split()[-1]) >= 0 for line in lines)
    assert not list(tmp_path.iterdir())
