from pathlib import Path

import torch

from benchmarks.dense import DenseConfig, main, score
from plat.modules import Expert, ExpertConfig
from plat.robots import G1


def still(action):
    """An expert whose network says nothing: its robot follows the reference's joints, or stands."""
    expert = Expert(G1, ExpertConfig(hidden=(8,), action=action))
    with torch.no_grad():
        for parameter in expert.network.parameters():
            parameter.zero_()
    return expert


def test_errors_grow_with_how_far_off_the_robot_is(library):
    follows, stands = (
        score(still(action), library, seconds=0.4) for action in ("reference_residual", "default_offset")
    )
    assert follows.clips == library.num_clips
    assert follows.joint < 0.9 * stands.joint
    assert follows.aligned < stands.aligned
    assert 0 < follows.seconds <= 0.4 * follows.clips + 1e-6


def test_a_fall_ends_a_clip(library):
    whole, short = (
        score(still("default_offset"), library, clips=0),
        score(still("default_offset"), library, seconds=0.1),
    )
    assert whole.failed > short.failed == 0
    length = sum(int(n) - 1 for n in library.clip_length) * library.dt
    assert whole.seconds < min(length, 8.0 * library.num_clips)


def test_a_row_for_each_expert_and_file(tmp_path, capsys):
    scores = main(DenseConfig(runs=(Path("expert-g1"),), motions=("generated:val/stand@4",), seconds=0.2))
    assert list(scores) == [("expert-g1", "generated:val/stand@4")]
    row = capsys.readouterr().out.splitlines()[-1].split()
    assert row[0] == "expert-g1"
    assert row[2].startswith("0/")
    assert float(row[4]) < 0.1
