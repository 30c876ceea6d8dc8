from pathlib import Path

from plat.robots import G1
from plat.spec.observation import OBSERVATION, Entry, observing
from plat.spec.observation_page import observation_page

PAGE = Path(__file__).parents[2] / "docs" / "observation.md"


def test_the_committed_page_is_what_the_table_says():
    written = observation_page(G1.num_joints, len(G1.keypoints))
    assert PAGE.read_text(encoding="utf-8") == written, "run: python -m plat.spec.observation_page docs/observation.md"


def test_a_new_entry_is_on_the_page_and_moves_what_follows():
    with observing(OBSERVATION.with_entry("goal", Entry("toy", "m", "world", size=2, commanded_by="root"))):
        page = observation_page(29, 14)
    assert "| `toy` | 2 | 176:178 | m | world | 1 | root |" in page
    assert "| `horizon` | 1 | 178:179 |" in page
