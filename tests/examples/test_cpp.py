"""The example in C++ is built, and computes what PolicyRunner computes."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plat.control import Chase, Simulator
from plat.deploy import PolicyRunner
from plat.keyframes import KeyframeSequence
from plat.motions.generation import generate_named
from plat.robots import G1

SOURCE = Path(__file__).parents[2] / "examples" / "cpp"
TOLERANCE = 1e-5  # rad: float32 observations of sums in another order
# where packages of onnxruntime put their headers; ONNXRUNTIME_INCLUDE names another folder
INCLUDES = [
    Path(root, *below)
    for root in ("/usr/include", "/usr/local/include")
    for below in ((), ("onnxruntime",), ("onnxruntime", "core", "session"))
]


def library() -> Path | None:
    """onnxruntime's shared library, which its wheel carries."""
    onnxruntime = pytest.importorskip("onnxruntime")
    found = sorted(Path(onnxruntime.__file__).parent.glob("capi/libonnxruntime.so*"))
    return found[0] if found else None


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program, built."""
    for tool in ("cmake", "c++"):
        if shutil.which(tool) is None:
            pytest.skip(f"the example in C++ needs {tool}")
    named = os.environ.get("ONNXRUNTIME_INCLUDE")
    folders = [Path(named)] if named else INCLUDES
    include = next((folder for folder in folders if (folder / "onnxruntime_cxx_api.h").exists()), None)
    if include is None:
        pytest.skip("the example in C++ needs onnxruntime's headers: set ONNXRUNTIME_INCLUDE")
    if not any(Path(root, "include", "nlohmann", "json.hpp").exists() for root in ("/usr", "/usr/local")):
        pytest.skip("the example in C++ needs nlohmann-json")
    found = library()
    if found is None:
        pytest.skip("the example in C++ needs onnxruntime's shared library, which this wheel lacks")
    folder = tmp_path_factory.mktemp("cpp")
    # the loader looks for it by its name without minor version
    for name in ("libonnxruntime.so", "libonnxruntime.so.1"):
        (folder / name).symlink_to(found)
    build = folder / "build"
    where = [f"-DONNXRUNTIME_INCLUDE={include}", f"-DONNXRUNTIME_LIBRARY={folder / 'libonnxruntime.so'}"]
    configure = ["cmake", "-S", str(SOURCE), "-B", str(build), "-DCMAKE_CXX_FLAGS=-Werror", *where]
    for command in (configure, ["cmake", "--build", str(build)]):
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout + result.stderr
    return build / "plat_policy"


def answers(program: Path, bundle: Path, steps: Iterable[Any]) -> list[Any]:
    lines = "".join(json.dumps(step) + "\n" for step in steps)
    result = subprocess.run([program, bundle], input=lines, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return [json.loads(line) for line in result.stdout.splitlines()]


def as_json(values: dict[str, Any]) -> dict[str, list[float]]:
    return {name: np.asarray(value).tolist() for name, value in values.items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["shipped_bundle", "small_bundle"])
def test_it_steps_as_the_runner_does(program: Path, name: str, request: pytest.FixtureRequest) -> None:
    """Kicks at 50 Hz; one policy sees more than the robot, the goal and the command, the other does not."""
    folder = request.getfixturevalue(name)
    clip = generate_named("generated:val/kick@6")[0]
    sequence = KeyframeSequence.from_motion(clip, np.arange(0.5, clip.duration, 0.5).tolist(), G1)
    chase = Chase(PolicyRunner(folder), sequence, Simulator(G1.model()))
    steps = [step for step, _ in zip(chase, range(100), strict=False)]
    poses = [step.command.keyframe for step in steps]
    inputs = [
        {
            "state": as_json(asdict(step.before)),
            "keyframe": {key: getattr(pose, key).tolist() for key in ("root_pos", "root_quat", "joint_pos")},
            "steps_left": step.command.steps_left,
        }
        for step, pose in zip(steps, poses, strict=True)
    ]
    targets = np.array(answers(program, folder, inputs))
    np.testing.assert_allclose(targets, [step.joint_target for step in steps], atol=TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["shipped_bundle", "small_bundle"])
def test_the_bundles_own_example(program: Path, name: str, request: pytest.FixtureRequest) -> None:
    folder = request.getfixturevalue(name)
    example = json.loads((folder / "example.json").read_text())
    (targets,) = answers(program, folder, [example])
    np.testing.assert_allclose(targets, example["joint_position_target"], atol=TOLERANCE)


@pytest.mark.slow
def test_it_refuses_and_goes_on(program: Path, small_bundle: Path) -> None:
    step = json.loads((small_bundle / "example.json").read_text())
    runner = PolicyRunner(small_bundle)
    (first,) = answers(program, small_bundle, [step])
    broken = [
        {**step, "steps_left": 0},
        {**step, "steps_left": 1000},
        {**step, "last_action": [0.0]},
        {**step, "state": {**step["state"], "joint_pos": [0.0]}},
        {**step, "state": {**step["state"], "root_quat_w": [2.0, 0.0, 0.0, 0.0]}},
        {**step, "state": {**step["state"], "root_lin_vel_b": [1e300, 0.0, 0.0]}},
        {**step, "keyframe": {**step["keyframe"], "commands": {"joints": []}}},
        {"state": step["state"]},
        [1, 2],
    ]
    *refused, last = answers(program, small_bundle, [*broken, step])
    assert [list(answer) for answer in refused] == [["error"]] * len(broken)
    # as if the refused steps had not been
    assert last == first
    assert len(last) == len(runner.robot.joint_names)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["shipped_bundle", "small_bundle"])
def test_times_that_are_rounded_mean_whole_steps(program: Path, name: str, request: pytest.FixtureRequest) -> None:
    folder = request.getfixturevalue(name)
    step = json.loads((folder / "example.json").read_text())
    longest = PolicyRunner(folder).timing.max_steps
    for whole in (3, longest):
        (exact,) = answers(program, folder, [{**step, "steps_left": whole}])
        (rounded,) = answers(program, folder, [{**step, "steps_left": whole + 3e-10}])
        assert rounded == exact


@pytest.mark.slow
def test_a_folder_that_is_no_bundle(program: Path, tmp_path: Path) -> None:
    result = subprocess.run([program, tmp_path], capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert result.stderr.startswith(f"plat_policy: {tmp_path}/bundle.json: cannot be read")
    assert len(result.stderr.splitlines()) == 1
