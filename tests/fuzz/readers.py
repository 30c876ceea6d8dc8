"""Every reader of plat with valid files that it reads."""

import json
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from plat.cli.benchmark_page import page
from plat.cli.curves import read as read_curve
from plat.deploy import Bundle, PolicyFacts, PolicyRunner, TrainingFacts
from plat.deploy.bundle import INPUT, METADATA_KEY, OUTPUT
from plat.errors import KeyframeError
from plat.evaluation.families import families_of, read_manifest
from plat.evaluation.records import STEP_METRICS, WINDOW_METRICS, CommandRecords
from plat.evaluation.study_files import read_study
from plat.json_file import parse_json
from plat.keyframes import KeyframeSequence, keyframe_from_json, keyframe_to_json, standing
from plat.keyframes.kimodo import read_constraints, write_constraints
from plat.keyframes.mjcf_keys import read_mjcf_keys, write_mjcf_keys
from plat.modules.dynamics import DynamicsConfig, DynamicsModel
from plat.motions.files import read_motion_files
from plat.motions.readers import READERS
from plat.motions.retargeting.skeletons import load_map
from plat.robots import G1, describe_robot
from plat.robots.registry import _read as read_robot
from plat.runs import SavedRun
from plat.runs.dynamics import DYNAMICS_FILE, load_dynamics, save_dynamics
from plat.runs.metrics import MetricsFile
from plat.spec.timing import Timing
from tests.cli.test_benchmark import ABOUT
from tests.export.runs import small_policy, write_run
from tests.motions.formats.writers import WRITERS, bowing_clip, link_arrays
from tests.motions.retargeting.human import write_human

__all__ = ["Subject", "subjects"]

_MAPS = Path(__file__).parents[2] / "plat" / "motions" / "retargeting" / "skeletons"
_ROBOT = Path(__file__).parents[1] / "robots" / "toy.json"
_MOST_RETARGETED = 20_000
_KINDS = {".csv": "text", ".bvh": "text", ".amc": "text", ".asf": "text", ".npz": "archive", ".pkl": "compressed"}
_KINDS |= {".json": "json", ".yaml": "text", ".txt": "text", ".xml": "text"}


@dataclass(frozen=True)
class Subject:
    """A reader and files that it reads, of which one is to be spoiled.

    Attributes:
        name: of reader and file.
        files: content of each by its name in a folder.
        target: the file to spoil.
        kind: of mutation, a key of ``tests.fuzz.mutations.MUTATIONS``.
        read: reads the folder or file at a path: that of ``start``.
        start: name in the folder that the reader is given; "" for the folder itself.
    """

    name: str
    files: dict[str, bytes]
    target: str
    kind: str
    read: Callable[[Path], object]
    start: str


def subjects() -> list[Subject]:
    """Return all of them; files are made in a folder that is gone afterwards."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    try:
        kinds = (_motions, _captures, _settings, _runs, _tables)
        return [*(subject for kind in kinds for subject in kind(folder)), *_bundles()]
    finally:
        shutil.rmtree(folder)


def _one(name: str, path: Path, read: Callable[[Path], object], kind: str = "") -> Subject:
    return Subject(name, {path.name: path.read_bytes()}, path.name, kind or _KINDS[path.suffix], read, path.name)


def _read_motions(path: Path) -> None:
    for file in read_motion_files(path):
        for clip in file.clips:
            assert np.isfinite(clip.qpos).all()
            assert file.facts


def _retarget(path: Path) -> None:
    # retargeting takes milliseconds a frame, which is no hang
    from plat.motions.retargeting.bvh import read_bvh

    (read_bvh if path.stat().st_size > _MOST_RETARGETED else _read_motions)(path)


def _motions(folder: Path) -> Iterator[Subject]:
    clip = bowing_clip(6)
    for name, write in WRITERS.items():
        path = folder / name
        write(path, clip)
        yield _one(f"motion {name}", path, _read_motions)
    np.save(folder / "root_joints.npy", clip.qpos)
    yield _one("motion .npy", folder / "root_joints.npy", _read_motions, "bytes")
    table = (folder / "headed_50fps.csv").read_bytes().replace(b",", b"\t")
    yield Subject("motion .tsv", {"a_50fps.tsv": table}, "a_50fps.tsv", "text", _read_motions, "a_50fps.tsv")
    archive = folder / "hdmi.npz"
    np.savez(archive, qpos=clip.qpos)
    meta = json.dumps({"fps": 50, "joint_names": G1.joint_names, "body_names": ["pelvis"]}).encode()
    files = {"hdmi.npz": archive.read_bytes(), "meta.json": meta}
    yield Subject("motion meta.json", files, "meta.json", "json", _read_motions, "hdmi.npz")
    links = folder / "kimodo.npz"
    np.savez(links, **link_arrays(clip))
    yield _one("motion kimodo.npz", links, _read_motions)
    # a file of another format under every ending that has a reader
    for suffix in READERS:
        for source in ("plat.npz", "asap.pkl", "headed_50fps.csv"):
            content, name = (folder / source).read_bytes(), f"{source.partition('.')[0]}{suffix}"
            yield Subject(f"{source} as {suffix}", {name: content}, name, "bytes", _read_motions, name)


def _captures(folder: Path) -> Iterator[Subject]:
    if not find_spec("scipy"):
        return
    from plat.motions.retargeting.asf import read_amc
    from plat.motions.retargeting.bvh import read_bvh
    from plat.motions.retargeting.joint_file import read_joint_file
    from tests.motions.retargeting.test_asf import write_amc, write_asf

    yield _one("bvh", write_human(folder / "human.bvh", frames=4), read_bvh)
    # a few go through retargeting, which takes much longer
    yield _one("retargeted bvh", write_human(folder / "walk.bvh", frames=4), _retarget)
    joints = folder / "joints.npz"
    places = np.random.default_rng(0).normal(0, 0.1, (4, 22, 3)) + np.linspace(0, 1.6, 22)[:, None] * [0, 1, 0]
    np.savez(joints, posed_joints=places, fps=30)
    yield _one("joints of a human .npz", joints, read_joint_file)
    write_asf(folder / "person.asf")
    write_amc(folder / "person.amc")
    files = {name: (folder / name).read_bytes() for name in ("person.asf", "person.amc")}
    for name in files:
        yield Subject(name[-3:], files, name, "text", read_amc, "person.amc")


def _settings(folder: Path) -> Iterator[Subject]:
    pose, path = standing(G1), folder / "wave.json"
    KeyframeSequence(G1, pose, (pose.at(0.5), pose.at(1.0))).save(path)
    yield _one("keyframes", path, lambda path: KeyframeSequence.load(path, G1, split=True))
    message = folder / "message.json"
    message.write_text(json.dumps(keyframe_to_json(pose.at(0.5), G1)))
    yield _one("keyframe message", message, _read_message)
    keys = folder / "keys.xml"
    write_mjcf_keys(keys, G1, (pose, pose.at(0.5)))
    yield _one("keys of a model", keys, lambda path: read_mjcf_keys(path, G1))
    constraints = folder / "constraints.json"
    write_constraints(constraints, G1, (pose, pose.at(0.5)))
    yield _one("constraints", constraints, lambda path: read_constraints(path, G1))
    files = {path.name: path.read_bytes() for path in (_ROBOT, _ROBOT.with_suffix(".xml"))}
    yield Subject("robot", files, _ROBOT.name, _KINDS[".json"], read_robot, _ROBOT.name)
    yield Subject("model of a robot", files, "toy.xml", "text", _read_model, "toy.json")
    manifest = folder / "manifest.csv"
    manifest.write_text("clip,family,seconds\nwalk_001,walk,3.5\nbow_002,bow,2\n")
    yield _one("manifest", manifest, _read_manifest)
    for name in ("lafan1", "mixamo"):
        found = sorted(_MAPS.glob(f"*{name}*.yaml")) or sorted(_MAPS.glob("*.yaml"))[:1]
        yield _one("skeleton map", found[0], load_map)


def _read_model(path: Path) -> None:
    describe_robot(read_robot(path), 0.02)


def _read_message(path: Path) -> None:
    keyframe_from_json(parse_json(path.read_bytes(), KeyframeError, "message"), G1)


def _read_manifest(path: Path) -> None:
    families = read_manifest([path])
    assert all(isinstance(word, str) for words in families.items() for word in words)
    families_of(["walk_001", "bow_002"], families)


def _run_files(folder: Path, kind: str) -> dict[str, bytes]:
    run = write_run(folder / kind, small_policy(kind))
    table = "policy,horizon,metric,value,low,high\nrun,long,tks,99.5,99.25,99.75\nrun,long,mpjpe,0.1,0.05,0.2\n"
    (run / "evaluation.csv").write_text(table)
    return {path.name: path.read_bytes() for path in run.iterdir()}


def _runs(folder: Path) -> Iterator[Subject]:
    for kind in ("residual_latent", "plain", "expert"):
        files = _run_files(folder, kind)
        policy = partial(_read_policy)
        yield Subject(f"config.json of {kind}", files, "config.json", "json", policy, "")
        yield Subject(f"weights of {kind}", files, "model.safetensors", "bytes", policy, "")
    yield Subject("evaluation.csv", files, "evaluation.csv", "text", _read_scores, "")
    records = folder / "records.safetensors"
    columns = {
        name: _column() for name in ("clip", "length", "steps", "failed", "fell", "window_steps", "arrival_error")
    }
    window, step = ({name: _column() for name in names} for names in (WINDOW_METRICS, STEP_METRICS))
    CommandRecords(**columns, window=window, step=step).save(records, {"policy": "run"})
    yield _one("records", records, CommandRecords.load, "bytes")

    shape = DynamicsConfig(hidden=(8,))
    model, folder = DynamicsModel(G1, shape), folder / "model"
    write_run(folder, small_policy("plain"), model=asdict(shape))
    save_dynamics(folder, model)
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    for name, kind in (("config.json", "json"), (DYNAMICS_FILE, "bytes")):
        yield Subject(f"{name} of a learned model", files, name, kind, lambda path: load_dynamics(path, G1), "")


def _tables(folder: Path) -> Iterator[Subject]:
    metrics = {"metrics.csv": b"step,seconds,loss,kl\n16,0.5,0.25,\n32,1.25,0.125,0.01\n48,2.5,0.0625,0.02\n"}
    yield Subject("metrics of a resumed run", metrics, "metrics.csv", "text", _resume_metrics, "")
    yield Subject("metrics that are drawn", metrics, "metrics.csv", "text", lambda path: read_curve(path, "loss"), "")
    figures, ends = "tks,0.99,0.98,1\n", "metric,value,low,high"
    study = {
        "scores.csv": f"policy,horizon,{ends}\nrun,long,{figures}run,mixed,{figures}".encode(),
        "groups.csv": f"grouping,group,count,policy,test,{ends}\nfamily,walk,3,run,mixed,{figures}".encode(),
        "robustness.csv": f"disturbance,strength,unit,policy,{ends}\npush,0.5,m/s,run,{figures}".encode(),
    }
    for name in study:
        yield Subject(f"{name} of a benchmark", study, name, "text", read_study, "")
    about = {**ABOUT, "robustness_clips": 3}
    yield Subject("about.json", {"about.json": json.dumps(about).encode()}, "about.json", "json", page, "")


def _resume_metrics(folder: Path) -> None:
    metrics = MetricsFile(folder / "metrics.csv", keep_until=32)
    metrics.write(64, {"loss": 0.5, "new": 1.0})


def _column() -> object:
    import torch

    return torch.zeros(3)


def _read_policy(folder: Path) -> None:
    run = SavedRun(folder)
    run.policy()
    assert isinstance(run.steps, int)
    assert isinstance(run.settings, dict)


def _read_scores(folder: Path) -> None:
    assert SavedRun(folder).scores is None or SavedRun(folder).scores


def _bundles() -> Iterator[Subject]:
    if not (find_spec("onnx") and find_spec("onnxruntime")):
        return
    content = Bundle(
        describe_robot(G1, 0.02), Timing(), PolicyFacts("plain", None, None), TrainingFacts("r", *[None] * 4), None
    ).to_json()
    files = {"policy.onnx": _network(content), "bundle.json": content.encode()}
    yield Subject("bundle.json", files, "bundle.json", "json", _read_bundle, "bundle.json")
    yield Subject(
        "policy.onnx", {"policy.onnx": files["policy.onnx"]}, "policy.onnx", "bytes", PolicyRunner, "policy.onnx"
    )


def _read_bundle(path: Path) -> None:
    Bundle.from_json(path.read_text(encoding="utf-8", errors="surrogateescape"), str(path))


def _network(metadata: str) -> bytes:
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    rng = np.random.default_rng(0)
    weights = [rng.normal(0, 0.1, shape).astype(np.float32) for shape in ((177, 16), (16, 29))]
    nodes = [
        helper.make_node("MatMul", [INPUT, "w0"], ["h0"]),
        helper.make_node("Elu", ["h0"], ["h1"]),
        helper.make_node("MatMul", ["h1", "w1"], [OUTPUT]),
    ]
    entry = helper.make_tensor_value_info(INPUT, TensorProto.FLOAT, ["batch", 177])
    result = helper.make_tensor_value_info(OUTPUT, TensorProto.FLOAT, ["batch", 29])
    constants = [numpy_helper.from_array(values, f"w{index}") for index, values in enumerate(weights)]
    graph = helper.make_graph(nodes, "policy", [entry], [result], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=9)
    helper.set_model_props(model, {METADATA_KEY: metadata})
    onnx.checker.check_model(model)
    return model.SerializeToString()
