import torch

from plat.tasks import PoseTable


def test_a_large_library_is_looked_up_where_it_is(library, monkeypatch):
    poses = PoseTable.of_poses(library.qpos(torch.tensor([3, 5])), library.robot)
    copied = PoseTable.of_library(library).then(poses)
    monkeypatch.setattr("plat.tasks.pose_table._COPIED", 10)
    alone = PoseTable.of_library(library)
    behind = alone.then(poses)
    assert behind.states.shape[0] == 2
    assert len(behind) == len(copied) == len(library) + 2
    row = torch.tensor([[0, 7, len(library) - 1], [len(library), len(library) + 1, 20]])
    for table, rows in ((behind, row), (alone, row.clamp_max(len(library) - 1))):
        for one, other in zip(table.state(rows), copied.state(rows), strict=True):
            assert one.equal(other)
        assert table.points(rows).equal(copied.points(rows))
        assert (table.pose(rows) == copied.pose(rows)).all()
