"""The example for Unitree's G1 against a simulated one in another process, by a stand-in for the SDK and by the SDK."""

import json
import os
import runpy
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from plat.errors import PlatError
from plat.keyframes import KeyframeSequence, standing
from plat.robots import G1

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


@pytest.mark.slow
@pytest.mark.parametrize("sdk", ["stand-in", "real"])
def test_a_simulated_g1_steps_aside(sdk, shipped_bundle, tmp_path):
    if sdk == "real":
        found = pytest.importorskip("unitree_sdk2py.core.channel", reason="needs Unitree's SDK for Python")
        if Path(str(found.__file__)).is_relative_to(HERE):  # other tests import the stand-in
            pytest.skip("needs Unitree's SDK for Python")
    pose = standing(G1)
    aside = replace(pose.at(1.0), root_pos=pose.root_pos + np.array([0.0, 0.25, 0.0]))
    KeyframeSequence(G1, pose, (aside,)).save(tmp_path / "aside.json")
    holders = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    for holder in holders:
        holder.bind(("127.0.0.1", 0))
    ports = ",".join(str(holder.getsockname()[1]) for holder in holders)
    for holder in holders:
        holder.close()
    ours_first = [str(HERE / "stand_in")] if sdk == "stand-in" else []
    path = os.pathsep.join((*ours_first, str(ROOT), os.environ.get("PYTHONPATH", "")))
    environment = {**os.environ, "STAND_IN_PORTS": ports, "PYTHONPATH": path}
    program = """
import sys, runpy
from pathlib import Path
from plat.deploy.safety import SafetySettings
module = runpy.run_path(sys.argv[1])
module["main"].__globals__.update(SILENCE=60.0, FIRST=60.0)
module["main"].__globals__["STAND"] = 0.5
print(module["main"](Path(sys.argv[2]), Path(sys.argv[3]), "lo", SafetySettings(ramp=0.2, hold=0.2, stand=0.3)))
"""
    arguments = [str(ROOT / "examples" / "unitree_g1.py"), str(shipped_bundle), str(tmp_path / "aside.json")]
    ours = subprocess.Popen([sys.executable, "-c", program, *arguments], env=environment,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # fmt: skip
    # -P: beside robot.py lies the stand-in
    theirs = subprocess.Popen([sys.executable, "-P", str(HERE / "stand_in" / "robot.py"), "60"], env=environment,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # fmt: skip
    try:
        out, errors = ours.communicate(timeout=300)
        # the SDK prints as well
        assert out.strip().splitlines()[-1] == "end", errors
        report, errors = theirs.communicate(timeout=100)
        result = json.loads(report.strip().splitlines()[-1]) if report else errors
        assert result["refused"] == 0
        assert abs(result["position"][1] - 0.25) < 0.1
        assert abs(result["position"][0]) < 0.1
        assert result["position"][2] > 0.65
    finally:
        ours.kill()
        theirs.kill()


def test_another_g1_is_refused_before_anything_moves(shipped_bundle, tmp_path, monkeypatch):
    pose, sent = standing(G1), []
    KeyframeSequence(G1, pose, (pose.at(1.0),)).save(tmp_path / "stand.json")
    monkeypatch.syspath_prepend(HERE / "stand_in")
    main = runpy.run_path(str(ROOT / "examples" / "unitree_g1.py"))["main"]
    robot = SimpleNamespace(
        receive=lambda seconds: SimpleNamespace(tick=5, mode_machine=6),
        send=lambda command, machine: sent.append((command, machine)),
    )
    main.__globals__["G1"] = lambda interface: robot
    with pytest.raises(PlatError, match="mode_machine is 6, expected 5"):
        main(shipped_bundle, tmp_path / "stand.json")
    ((command, machine),) = sent
    assert not command.stiffness.any()
    assert machine == 6
