import sys
from importlib.metadata import version
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from compare import Row, installed_version, rows_of, table
from rivals import Rival, Setup, Work


def rival(name: str) -> Rival:
    return Rival(name, name, f"pip install {name}", lambda setup, stack: Work())


def test_ratios_are_ours_over_theirs_within_rounds():
    values = {
        "plat/collect": [100.0, 50.0, 110.0],
        "plat/learn": [60.0, 30.0, 60.0],
        "slow/collect": [25.0, 12.5, 20.0],
        "learner/learn": [30.0, 15.0, 30.0],
    }
    rivals = [rival(name) for name in ("plat", "slow", "learner", "absent")]
    versions = {"plat": "1", "slow": "2", "learner": "3", "absent": None}
    assert rows_of(rivals, versions, values) == [
        Row("plat", "1", collect=100.0, collect_ratio=1.0, learn=60.0, learn_ratio=1.0),
        Row("slow", "2", collect=20.0, collect_ratio=4.0),
        Row("learner", "3", learn=30.0, learn_ratio=2.0),
        Row("absent", "-", "not installed: pip install absent"),
    ]


def test_the_table_says_what_is_missing_and_goes_on():
    text = table(
        [Row("absent", "-", "not installed: pip install absent"), Row("slow", "2", collect=20.0, collect_ratio=4.0)]
    )
    absent, slow = text.splitlines()[1:]
    assert absent.split() == ["absent", "-", "not", "installed:", "pip", "install", "absent"]
    assert slow.split() == ["slow", "2", "20", "4.00", "x", "-", "-"]


def test_versions_are_looked_for_in_a_folder(tmp_path):
    info = tmp_path / "mjbatch-0.9.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mjbatch\nVersion: 0.9\n")
    assert installed_version("mjbatch", tmp_path) == "0.9"
    assert installed_version("torch", tmp_path) is None
    assert installed_version("torch") == version("torch")
    assert installed_version("no-such-package-at-all") is None


def test_rollouts_of_all_rivals_hold_the_same_samples():
    assert Setup(motions=(), num_envs=32, num_singles=4).samples == pytest.approx(32 * 24)
