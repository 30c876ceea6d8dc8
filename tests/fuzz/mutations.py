"""Seeded mutations of valid files: of bytes, of the words of a text, of JSON values, of members of an archive."""

import io
import json
import random
import re
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

__all__ = ["MUTATIONS", "Mutation"]

Mutation = Callable[[random.Random, bytes], bytes]
"""From a generator and a valid content to a spoiled one."""

_LONGEST = 4 << 20
_NUMBERS = ("nan", "inf", "-inf", "1e309", "-1e309", "1e-400", "0", "-1", "-0.0", "9" * 400, "1" * 5000, "0x10", "1_0")
_NUMBERS += ("1e30", "99999999999", str(2**31), str(2**63), "1,5", "--1", "1e", "٣", "", "true", "null", "'", '"')
_WORDS = ("", "{", "}", "[", "]", ":", "&a", "*a", "<<", "!!python/object/apply:os.system [id]", "\ud800", "\x00", "é")
_WORDS += ("a" * 10_000, "\\ud800", "../../etc/passwd", "%s%n", "\r", "\n\n", "\t", "- - - -", "? ", "|", "# ")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_ODD: tuple[Callable[[], Any], ...] = (
    lambda: None,
    lambda: True,
    lambda: -1,
    lambda: 0,
    lambda: 10**400,
    lambda: 2**63,
    lambda: 1e308,
    lambda: 1e-320,
    lambda: float("nan"),
    lambda: float("inf"),
    lambda: "",
    lambda: "\ud800",
    lambda: "\x00\n\u2028",
    lambda: "x" * 20_000,
    lambda: "../../../../etc/passwd",
    lambda: "/dev/zero",
    list,
    dict,
    lambda: [[]],
    lambda: {"": {}},
    lambda: [1] * 1000,
    lambda: [10**9] * 3,
    lambda: 10**9,
    lambda: 1_000_000,
    lambda: "1",
    lambda: {"kind": "plain"},
)
"""Values that do not belong where they are put."""


def _bytes(rng: random.Random, content: bytes) -> bytes:
    """Flip, cut out, double, insert or end."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 4, 16))):
        if not data:
            break
        # headers are at the start, and the directory of an archive at the end
        at = rng.choice((rng.randrange(len(data)), rng.randrange(min(300, len(data))), -rng.randrange(1, 201)))
        at = at % len(data)
        length = rng.choice((1, 2, 4, 8, 100, 4000))
        action = rng.randrange(7)
        if action <= 1:
            data[at] ^= 1 << rng.randrange(8)
        elif action == 2:
            data[at] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))
        elif action == 3:
            del data[at : at + length]
        elif action == 4:
            data[at:at] = data[at : at + length] * rng.choice((1, 1, 3, 50))
        elif action == 5:
            data[at : at + 4] = rng.choice(
                (b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff", b"\x00\x00\x00\x00", rng.randbytes(4))
            )
        else:
            del data[at:]
    return bytes(data[:_LONGEST])


def _text(rng: random.Random, content: bytes) -> bytes:
    """Put other numbers, words and lines into a text."""
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        action = rng.randrange(8)
        if action <= 2:
            content = _another_number(rng, content)
            continue
        lines = content.split(b"\n")
        at = rng.randrange(len(lines))
        if action == 3:
            words = lines[at].split(b" ")
            words[rng.randrange(len(words))] = rng.choice(_WORDS).encode("utf-8", "surrogatepass")
            lines[at] = b" ".join(words)
        elif action == 4:
            del lines[at : at + rng.choice((1, 1, 3, 100))]
        elif action == 5:
            block = lines[at : at + rng.choice((1, 1, 5))]
            lines[at:at] = block * rng.choice((1, 1, 20, 5000))
        elif action == 6:
            other = rng.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
        else:
            lines[at] = _another_number(rng, lines[at]) + rng.choice((b"", b" 1", b"," * 100, b" {", b"\t-"))
        content = b"\n".join(lines)[:_LONGEST]
    return content


def _another_number(rng: random.Random, content: bytes) -> bytes:
    found = list(_NUMBER.finditer(content[: 1 << 16]))
    if not found:
        return content
    match = rng.choice(found)
    return content[: match.start()] + rng.choice(_NUMBERS).encode() + content[match.end() :]


def _json(rng: random.Random, content: bytes) -> bytes:
    """Put another value, field or depth somewhere into a JSON value, or spoil its text."""
    if rng.random() < 0.25:
        return _text(rng, content)
    value = json.loads(content)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        value = _other_value(rng, value)
    text = json.dumps(value)
    action = rng.randrange(20)
    if action == 0:
        text = re.sub(r'"(\w+)":', r'"\1": 0, "\1":', text, count=1)
    elif action == 1:
        depth = rng.choice((20, 900, 1100, 50_000))
        text = text.replace(rng.choice(("0", "null", "1")), "[" * depth + "]" * depth, 1)
    elif action == 2:
        text = text.replace("e", "\\ud83d", 1)
    return text.encode("utf-8", "surrogatepass")


def _other_value(rng: random.Random, value: Any) -> Any:
    """Return the value with another one somewhere in it."""
    if isinstance(value, (dict, list)) and value and rng.random() < 0.9:
        keys = list(value) if isinstance(value, dict) else range(len(value))
        key = rng.choice(keys)
        action = rng.random()
        if action < 0.75:
            value[key] = _other_value(rng, value[key])
        elif action < 0.85:
            del value[key]
        elif isinstance(value, list):
            value[key:key] = [value[key]] * rng.choice((1, 2, 500))
        else:
            value[rng.choice(("", "extra", "\ud800", "x" * 5000, "__class__"))] = value[key]
        return value
    return rng.choice(_ODD)()


def _archive(rng: random.Random, content: bytes) -> bytes:
    """Spoil a member of a zip archive and pack it again, or spoil the archive's bytes."""
    if rng.random() < 0.3:
        return _bytes(rng, content)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    at = rng.randrange(len(members))
    name, data = members[at]
    action = rng.randrange(10)
    if action <= 4:
        members[at] = name, _header(rng, data)
    elif action == 5:
        members[at] = name, _bytes(rng, data)
    elif action == 6:
        members.append(
            (rng.choice((name, "meta.npy", "../up.npy", "\ud83d.npy".encode("utf-16", "surrogatepass").hex())), data)
        )
    elif action == 7:
        del members[at]
    elif action == 8:
        members[at] = rng.choice(("joint_pos.npy", "qpos.npy", "fps.npy", "joint_names.npy", "x" * 3000)), data
    else:
        other = rng.randrange(len(members))
        members[at] = name, members[other][1]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", rng.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED))) as archive:
        for name, data in members:
            archive.writestr(zipfile.ZipInfo(name), data)
    return packed.getvalue()


def _header(rng: random.Random, data: bytes) -> bytes:
    """Spoil what an array says of itself."""
    end = data.find(b"\n", 0, 400)
    header = data[:end]
    action = rng.randrange(4)
    if action == 0:
        shape = rng.choice(
            ("()", "(0,)", "(1000000000, 0)", "(2, 36, 1)", "(-1, 36)", "(99999999999,)", "(" + "1," * 40 + ")")
        )
        header = re.sub(rb"\([\d, ]*\)", shape.encode(), header)
    elif action == 1:
        kinds = (
            "<f8",
            "<f4",
            ">f4",
            "|i1",
            "<i8",
            "|O",
            "<U0",
            "|S0",
            "|V8",
            "<c16",
            "<M8[s]",
            "|b1",
            "<f16",
            "<U99999",
        )
        header = re.sub(rb"'[<>|=][^']*'", f"'{rng.choice(kinds)}'".encode(), header)
    elif action == 2:
        return data[:end] + _bytes(rng, data[end:])
    else:
        header = _bytes(rng, header)
    return header + data[end:]


def _compressed(rng: random.Random, content: bytes) -> bytes:
    """Spoil what a compressed stream holds, or the stream."""
    if content[:2] != b"\x1f\x8b" or rng.random() < 0.3:
        return _bytes(rng, content)
    data = _bytes(rng, zlib.decompress(content, 31))
    packer = zlib.compressobj(wbits=31)
    return packer.compress(data) + packer.flush()


MUTATIONS: dict[str, Mutation] = {
    "bytes": _bytes,
    "text": lambda rng, content: (_bytes if rng.random() < 0.2 else _text)(rng, content),
    "json": _json,
    "archive": _archive,
    "compressed": _compressed,
}
"""How the files of a kind are spoiled."""
