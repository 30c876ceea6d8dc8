import json
import socket

import numpy as np
import pytest

from examples.planner_in_the_loop import Lines, main, obey, standing_at
from plat.keyframes import KeyframeQueue, keyframe_to_json
from plat.robots import G1


@pytest.mark.slow
def test_hands_follow_a_program_in_another_process(shipped_bundle):
    result = main(shipped_bundle, seconds=1.5, lockstep=True)
    assert result["answers"] == {"queued": 15, "late": 1, "canceled": 1}
    assert result["hands_off"] < 0.1
    assert result["height"] > 0.65
    assert result["mode"] == "end"
    assert not any(line.startswith(("watchdog", "tilt", "height", "policy")) for line in result["stepped_in"])


def test_messages_that_make_no_sense_are_refused():
    queue, here = KeyframeQueue(G1), standing_at(G1, np.zeros(3))
    good = {"put": keyframe_to_json(here.at(0.5), G1)}
    assert obey(good, queue, 0.0, here) == "queued"
    broken = json.loads(json.dumps(good))
    broken["put"]["root_pos"] = [0, "x", 1]
    for message in (None, [], 7, {}, {"put": None}, {"put": {}}, broken):
        assert obey(message, queue, 0.0, here).startswith("refused: ")
    assert len(queue) == 1
    assert obey({"cancel": True}, queue, 0.0, here) == "canceled"
    assert queue.command(0.0).keyframe.time == 0.5


def test_lines_that_are_cut_or_broken():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        lines = Lines(ours)
        theirs.sendall(b'{"a": 1}\n{"b"')
        assert lines.receive(1.0) == [{"a": 1}]
        theirs.sendall(b": 2}\nnonsense\n\xff\n")
        assert lines.receive(1.0) == [{"b": 2}, None, None]
        assert lines.receive(0.0) == []
        assert lines.open
        theirs.close()
        assert lines.receive(1.0) == []
        assert not lines.open
        lines.send({"late": True})
