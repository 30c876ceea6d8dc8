"""Small files that would take much memory or time if their reader believed them."""

import gzip
import io
import json
import pickle
import random
import zipfile
from collections.abc import Callable

import numpy as np

__all__ = ["BOMBS", "Bomb"]

Bomb = Callable[[random.Random, bytes], bytes]
"""From a generator and a valid file of the kind to a bomb."""

_MEGA = 1 << 20


def _npz(**arrays: np.ndarray) -> bytes:
    packed = io.BytesIO()
    np.savez_compressed(packed, **arrays)
    return packed.getvalue()


def _long_clip(rng: random.Random, _: bytes) -> bytes:
    """A clip of small integers, which become eight bytes each."""
    kind = rng.choice((np.int8, np.uint8, np.float16, np.int16, np.float64))
    rows = rng.choice((1, 10, 60)) * _MEGA // (36 * np.dtype(kind).itemsize)
    qpos = np.zeros((rows, 36), kind)
    qpos[:, 3] = 1
    return _npz(qpos=qpos, fps=np.array(50))


def _many_clips(rng: random.Random, _: bytes) -> bytes:
    """Thousands of the smallest clips."""
    qpos = np.zeros((2, 36), np.int8)
    qpos[:, 3] = 1
    return _npz(fps=np.array(50), **{f"c{index}": qpos for index in range(rng.choice((300, 3000)))})


def _rows_of_nothing(rng: random.Random, _: bytes) -> bytes:
    """Arrays of a thousand million empty rows."""
    shape = rng.choice(((10**9, 0), (0, 10**9), (10**9, 0, 3)))
    empty = np.zeros(0)
    arrays = {name: empty.reshape(0) for name in ("joint_pos", "body_pos_w", "joint_names")}
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name in arrays:
            member = io.BytesIO()
            kind = rng.choice(("<f8", "<U0", "|S0"))
            np.lib.format.write_array_header_1_0(member, {"descr": kind, "fortran_order": False, "shape": shape})
            archive.writestr(f"{name}.npy", member.getvalue())
        member = io.BytesIO()
        np.save(member, np.array(50))
        archive.writestr("fps.npy", member.getvalue())
    return packed.getvalue()


def _shared_arrays(rng: random.Random, _: bytes) -> bytes:
    """A pickle that calls one array by thousands of names."""
    motion = {
        "root_pos": np.zeros((2, 3)),
        "root_rot": np.tile([0.0, 0, 0, 1], (2, 1)),
        "dof_pos": np.zeros((2, 29)),
        "fps": 50,
    }
    return pickle.dumps(dict.fromkeys(map(str, range(rng.choice((1000, 20_000)))), motion), 4)


def _many_motions(rng: random.Random, _: bytes) -> bytes:
    """A pickle of many of the smallest motions, packed."""

    def motion() -> dict[str, object]:
        return {
            "root_pos": np.zeros((2, 3), np.int8),
            "root_rot": np.tile(np.int8([0, 0, 0, 1]), (2, 1)),
            "dof_pos": np.zeros((2, 29), np.int8),
            "fps": 50,
        }

    data = pickle.dumps({str(index): motion() for index in range(rng.choice((300, 3000)))}, 4)
    return rng.choice((data, gzip.compress(data)))


def _long_motion(rng: random.Random, _: bytes) -> bytes:
    rows = rng.choice((100_000, 800_000))
    motion = {
        "root_pos": np.zeros((rows, 3), np.int8),
        "root_rot": np.tile(np.int8([0, 0, 0, 1]), (rows, 1)),
        "dof_pos": np.zeros((rows, 29), np.int8),
        "fps": 50,
    }
    return gzip.compress(pickle.dumps(motion, 4))


def _program(rng: random.Random, _: bytes) -> bytes:
    """Pickles that call a program."""
    return rng.choice(
        (
            b"cos\nsystem\n(S'true'\ntR.",
            b"\x80\x04\x8c\x05posix\x94\x8c\x06system\x94\x93\x94\x8c\x04true\x94\x85\x94R\x94.",
            b'cbuiltins\neval\n(S\'__import__("os").system("true")\'\ntR.',
            b"csubprocess\nPopen\n((S'true'\nltR.",
        )
    )


def _digits(rng: random.Random, _: bytes) -> bytes:
    """A pickle with a number of many digits, or of many numbers."""
    return b"I" + b"9" * rng.choice((4000, 5000, 200_000)) + b"\n."


def _deep(rng: random.Random, _: bytes) -> bytes:
    return b"\x80\x04" + b"]" * 30_000 + b"a" * 29_999 + b"."


def _thin_table(rng: random.Random, _: bytes) -> bytes:
    """A table of the shortest rows."""
    row = ",".join(["0"] * 3 + ["1", "0", "0", "0"] + ["0"] * 29)
    return "\n".join([row] * rng.choice((2000, 30_000))).encode()


def _wide_table(rng: random.Random, _: bytes) -> bytes:
    width = rng.choice((10_000, 500_000))
    return b"\n".join([b",".join([b"1"] * width)] * 3)


def _long_cells(rng: random.Random, _: bytes) -> bytes:
    cell = rng.choice((b"1", b"9", b"a", b"0.")) * rng.choice((10_000, 1_000_000))
    return b"\n".join([b",".join([cell] * 2 + [b"1"] * 34)] * 2)


def _thin_bvh(rng: random.Random, _: bytes) -> bytes:
    """A skeleton of many joints, one of them with a channel, over many frames."""
    joints, frames = rng.choice(((1000, 10_000), (200, 40_000), (2500, 1000)))
    lines = ["HIERARCHY", "ROOT a {", "OFFSET 0 0 0", "CHANNELS 1 Xrotation"]
    for index in range(joints):
        lines += [f"JOINT j{index} {{", "OFFSET 0 1 0"]
    lines += ["}"] * (joints + 1)
    lines += ["MOTION", f"Frames: {frames}", "Frame Time: 0.01", *(["0"] * frames)]
    return "\n".join(lines).encode()


def _thin_amc(rng: random.Random, content: bytes) -> bytes:
    """Frames without a value."""
    return content + "\n".join(map(str, range(rng.choice((10_000, 50_000))))).encode()


def _many_bones(rng: random.Random, content: bytes) -> bytes:
    bones = b"".join(
        b"begin\nname b%d\nlength 1\ndirection 0 1 0\naxis 0 0 0 XYZ\nend\n" % index for index in range(3000)
    )
    tree = b"".join(b"b%d b%d\n" % (index, index + 1) for index in range(2999))
    return content.replace(b":bonedata\n", b":bonedata\n" + bones, 1) + b"\nroot b0\n" + tree


def _json_depth(rng: random.Random, _: bytes) -> bytes:
    opening, closing = rng.choice((("[", "]"), ('{"a":', "}")))
    return (opening * 100_000 + "1" + closing * 100_000).encode()


def _json_width(rng: random.Random, _: bytes) -> bytes:
    item = rng.choice(("{}", "[]", "0", '""', '{"a":[]}'))
    return ("[" + ",".join([item] * rng.choice((100_000, 1_500_000))) + "]").encode()


def _json_names(rng: random.Random, _: bytes) -> bytes:
    names = [f'"{index}":0' for index in range(40_000)]
    return ("{" + ",".join([*names, '"7":0']) + "}").encode()


def _large_sizes(rng: random.Random, content: bytes) -> bytes:
    """Settings of networks that are far too large."""
    try:
        values = json.loads(content)
        config = values["policy"]["config"]
    except (ValueError, KeyError, TypeError):
        return content
    if "student" in values["policy"] and rng.random() < 0.5:
        config = values["policy"]["student"]["config"]
    name = rng.choice([name for name, value in config.items() if isinstance(value, (int, list))])
    sizes = ([100_000] * 2, [10**9], [8] * 30_000, [40_000] * 3, [10**400])
    config[name] = rng.choice(sizes) if isinstance(config[name], list) else rng.choice((10**9, 10**6, 10**400))
    return json.dumps(values).encode()


def _far_keyframe(rng: random.Random, content: bytes) -> bytes:
    try:
        values = json.loads(content)
        pose = values["keyframes"][0]
    except (ValueError, KeyError, TypeError, IndexError):
        return content
    times = rng.choice(
        (
            [1e9],
            [86_400.0],
            [3600.0 * hour for hour in range(1, 24)],
            [1e-9, 2e-9],
            [0.02 * k for k in range(1, 20_000)],
        )
    )
    values["keyframes"] = [{**pose, "time": time} for time in times]
    return json.dumps(values).encode()


def _aliases(rng: random.Random, _: bytes) -> bytes:
    """A thousand million references to one text."""
    lines = ["units: &a0 [x, x]"]
    lines += [f"k{n}: &a{n} [*a{n - 1}, *a{n - 1}, *a{n - 1}, *a{n - 1}]" for n in range(1, 30)]
    return "\n".join([*lines, "joints: *a29", "up: *a29"]).encode()


def _yaml_depth(rng: random.Random, _: bytes) -> bytes:
    return rng.choice((b"joints: " + b"[" * 20_000, b"joints: " + b"{a: " * 5000, b"- " * 20_000, b"? " * 20_000))


def _yaml_values(rng: random.Random, content: bytes) -> bytes:
    value = rng.choice(
        (b"2001-99-99", b"9" * 5000, b"!!binary xx", b"!!float x", b"!!int x", b"1:60:99", b"*none", b"{[]: 1}")
    )
    return content + b"\nunits: " + value + b"\n"


def _deep_model(rng: random.Random, content: bytes) -> bytes:
    """Networks that make large tensors of nothing."""
    import onnx
    from onnx import TensorProto, helper

    model = onnx.load_from_string(content)
    graph = model.graph
    last = graph.node[-1]
    output = last.output[0]
    last.output[0] = "inner"
    size = rng.choice((10**9, 3 * 10**9, 10**12))
    graph.initializer.append(helper.make_tensor("shape", TensorProto.INT64, (1,), [size]))
    graph.node.append(helper.make_node("ConstantOfShape", ["shape"], ["many"]))
    graph.node.append(helper.make_node("ReduceMax", ["many"], ["zero"], keepdims=0))
    graph.node.append(helper.make_node("Add", ["inner", "zero"], [output]))
    return model.SerializeToString()


def _many_includes(rng: random.Random, _: bytes) -> bytes:
    """A model that includes itself, again and again."""
    name = rng.choice(("keys.xml", "toy.xml"))
    return b"<mujoco>" + f'<include file="{name}"/>'.encode() * rng.choice((60, 5000)) + b"</mujoco>"


def _deep_elements(rng: random.Random, _: bytes) -> bytes:
    depth = rng.choice((500, 200_000))
    return b"<mujoco><worldbody>" + b"<body>" * depth + b"</body>" * depth + b"</worldbody></mujoco>"


def _entities(rng: random.Random, _: bytes) -> bytes:
    """Entities of entities, in an encoding in which they are not seen at once."""
    steps = "".join(f'<!ENTITY a{number + 1} "{f"&a{number};" * 20}">' for number in range(8))
    text = f'<!DOCTYPE mujoco [<!ENTITY a0 "0">{steps}]><mujoco><keyframe><key qpos="&a8;"/></keyframe></mujoco>'
    return text.encode(rng.choice(("utf-16", "utf-8")))


BOMBS: dict[str, tuple[Bomb, ...]] = {
    ".npz": (_long_clip, _many_clips, _rows_of_nothing),
    ".pkl": (_shared_arrays, _many_motions, _long_motion, _program, _digits, _deep),
    ".csv": (_thin_table, _wide_table, _long_cells),
    ".bvh": (_thin_bvh,),
    ".amc": (_thin_amc,),
    ".asf": (_many_bones,),
    ".json": (_json_depth, _json_width, _json_names, _large_sizes, _far_keyframe),
    ".yaml": (_aliases, _yaml_depth, _yaml_values),
    ".onnx": (_deep_model,),
    ".xml": (_many_includes, _deep_elements, _entities),
}
"""By the ending of a file."""
