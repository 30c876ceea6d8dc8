from collections import Counter

import numpy as np

from plat.motions.retargeting import split_of


def test_shares():
    counts = Counter(split_of(f"clip_{index}") for index in range(5000))
    assert abs(counts["test"] - 500) < 60
    assert abs(counts["val"] - 500) < 60


def test_the_rule_is_that_of_the_split_in_use(shared_data):
    for split in ("train", "val"):
        with np.load(shared_data / "motions" / f"bandai_{split}.npz") as archive:
            assert {split_of(name) for name in archive.files if name != "fps"} == {split}
