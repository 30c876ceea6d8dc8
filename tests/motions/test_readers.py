from pathlib import Path

import plat.motions.formats
from plat.motions.readers import READERS


def test_every_ending_has_a_reader():
    tables = {".csv", ".tsv", ".txt", ".npy"}
    assert set(READERS) == {".npz", *tables, ".pkl", ".pickle", ".joblib", ".bvh", ".amc"}
    assert all(ending == ending.lower() for ending in READERS)


def test_formats_do_not_know_retargeting():
    modules = list(Path(plat.motions.formats.__file__).parent.glob("*.py"))
    assert len(modules) > 5
    assert not [
        path.name for path in modules if "import" in path.read_text() and "motions.retargeting" in path.read_text()
    ]
