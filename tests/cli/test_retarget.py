import re

import numpy as np

from plat.motions import load_motions
from tests.in_process import Ended, run_plat
from tests.motions.retargeting.human import write_human


def run(*arguments: object) -> Ended:
    return run_plat("motions", "retarget", *arguments)


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


def test_captures_of_one_name_keep_their_motions(tmp_path):
    for name in ("x/a/clip", "y/a/clip", "z/a_clip_2"):
        (tmp_path / name).parent.mkdir(parents=True)
        write_human(tmp_path / f"{name}.bvh", frames=4)
    assert run(tmp_path / "x", tmp_path / "y", tmp_path / "z", "--out", tmp_path / "out").returncode == 0
    assert len(load_motions(tmp_path / "out")) == 3


def test_a_split_of_other_captures_does_not_stay(tmp_path):
    folder, out = tmp_path / "bvh", tmp_path / "motions"
    folder.mkdir()
    for name in ("clip_0", "clip_1"):
        write_human(folder / f"{name}.bvh", frames=5)
    assert run(folder, "--out", out, "--split").returncode == 0
    (folder / "clip_1.bvh").unlink()
    result = run(folder, "--out", out, "--split")
    assert f"removed {out / 'val.npz'} of an earlier start" in result.stdout
    assert [path.name for path in out.iterdir()] == ["train.npz"]


def test_a_unit_of_angles_is_for_files_that_have_angles(tmp_path):
    np.savez(tmp_path / "person.npz", posed_joints=np.zeros((4, 22, 3)), fps=30)
    result = run(tmp_path, "--out", tmp_path / "out", "--angles", "radians")
    assert result.returncode != 0
    assert "--angles: takes effect only with files that have angles, .bvh or .amc" in result.stderr


def test_a_split_of_captures_of_several_rates_has_the_commonest(tmp_path):
    folder, out = tmp_path / "bvh", tmp_path / "motions"
    folder.mkdir()
    for name, step in (("clip_0", "0.0333333"), ("clip_2", "0.0333333"), ("clip_3", "0.0083333")):
        path = folder / f"{name}.bvh"
        write_human(path, frames=9)
        path.write_text(re.sub(r"Frame Time: .*", f"Frame Time: {step}", path.read_text()))
    result = run(folder, "--out", out, "--split")
    assert result.returncode == 0, result.stderr
    assert {clip.name for path in out.glob("*.npz") for clip in load_motions(path)} == {"clip_0", "clip_2", "clip_3"}


def test_where_no_map_fits_one_is_proposed(tmp_path):
    odd = {"Hips": "Bassin", "LeftUpLeg": "CuisseLeft", "RightUpLeg": "CuisseRight"}
    write_human(tmp_path / "odd.bvh", frames=3, names=odd)
    arguments = (tmp_path / "odd.bvh", "--out", tmp_path / "out")
    result = run(*arguments)
    assert result.returncode != 0
    assert "write a map for them" in result.stdout
    assert "proposed_map.yaml: a map to check and to pass with --map" in result.stdout
    proposed = tmp_path / "out" / "proposed_map.yaml"
    corrected = proposed.read_text().replace("pelvis_pitch: 0.0", "pelvis_pitch: 3.0")
    proposed.write_text(corrected)
    for _ in range(2):  # what was corrected stays, and what is the same is not written again
        assert "wrote " + str(proposed.with_name("proposed_map_2.yaml")) in run(*arguments).stdout
    assert proposed.read_text() == corrected
    assert len(list((tmp_path / "out").iterdir())) == 2
    result = run(tmp_path / "odd.bvh", "--map", proposed, "--out", tmp_path / "out")
    assert result.returncode == 0
    assert (tmp_path / "out" / "odd.npz").exists()


def test_what_was_found_stands_beside_each_clip(tmp_path):
    write_human(tmp_path / "a.bvh", frames=3, up="z")
    text = (tmp_path / "a.bvh").read_text()
    (tmp_path / "a.bvh").write_text(text.replace("Frames: 3", "Frames: 4").replace("0.033333", "33.3333"))
    told = "33.33 if it is the rate itself); state it: plat motions retarget --fps"  # which has the option too
    assert told in run(tmp_path / "a.bvh", "--out", tmp_path / "out").stdout
    result = run(tmp_path / "a.bvh", "--fps", "30", "--out", tmp_path / "out")
    assert "map lafan1, 3 frames, for 'Frames:' says 4, z up and not y, as stated: the body" in result.stdout
