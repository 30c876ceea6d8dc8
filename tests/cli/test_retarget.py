import subprocess
import sys
from pathlib import Path

from plat.motions import load_motions
from tests.motions.retargeting.human import write_human

ROOT = Path(__file__).parents[2]


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "plat", "motions", "retarget", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)


def test_good_files_are_written_and_a_broken_one_is_named(tmp_path):
    folder, out = tmp_path / "bvh", tmp_path / "motions"
    folder.mkdir()
    # clip_0 is train and clip_1 is val by the rule
    for name in ("clip_0", "clip_1"):
        write_human(folder / f"{name}.bvh", frames=5)
    (folder / "broken.bvh").write_text("HIERARCHY\nROOT\n")
    result = run(folder, "--out", out, "--split")
    assert result.returncode != 0
    assert "skipped: BVH file" in result.stdout
    assert "broken.bvh', line 2: 'ROOT', expected a name" in result.stdout
    assert "1 of 3 files could not be used" in result.stderr
    assert [path.name for path in sorted(out.iterdir())] == ["train.npz", "val.npz"]
    assert [clip.name for clip in load_motions(out)] == ["clip_0", "clip_1"]
