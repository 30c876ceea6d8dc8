"""``plat motions map``: pictures of maps, and proposed ones."""

from functools import partial

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions.retargeting import load_map, read_bvh
from tests.cli import motion_commands
from tests.motions.retargeting.human import write_human
from tests.motions.retargeting.test_propose import ODD

run = partial(motion_commands.run, "map")


def test_known_and_proposed_maps_are_drawn(tmp_path, capsys):
    write_human(tmp_path / "known.bvh", frames=3)
    write_human(tmp_path / "odd.bvh", frames=3, names=ODD)
    written = run(tmp_path / "known.bvh", tmp_path / "odd.bvh", "--out", tmp_path / "out")
    assert [path.name for path in written] == ["known_map.png", "odd_map.yaml", "odd_map.png"]
    assert all(path.stat().st_size > 100 for path in written)
    assert load_map(written[1]).joints["hips"] == "Bassin"
    out = capsys.readouterr().out
    assert "known map 'lafan1'" in out
    assert "proposed map 'proposed'" in out


def test_a_capture_without_frames_is_named_and_one_of_any_rate_is_drawn(tmp_path, capsys):
    mocap = read_bvh(write_human(tmp_path / "a.bvh", frames=3))
    np.savez(tmp_path / "b.npz", joints=mocap.positions[:0], joint_names=list(mocap.names), fps=30)
    np.savez(tmp_path / "c.npz", joints=mocap.positions, joint_names=list(mocap.names), fps=0)
    with pytest.raises(MotionError, match="no map, or one that looks wrong: 1 of 3 files"):
        run(tmp_path, "--out", tmp_path / "out")
    assert "b.npz': 0 frames, expected at least 2" in capsys.readouterr().out
    assert (tmp_path / "out" / "c_map.png").exists()


def test_what_has_no_map_is_named(tmp_path, capsys):
    names = {name: f"joint{number}" for number, name in enumerate(ODD)}
    write_human(tmp_path / "odd.bvh", frames=3, names=names)
    with pytest.raises(MotionError, match="no map, or one that looks wrong: 1 of 1 file; see above"):
        run(tmp_path / "odd.bvh", "--out", tmp_path / "out")
    assert "skipped: BVH file" in capsys.readouterr().out
