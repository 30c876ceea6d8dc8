import io
import os
import pickle
import struct
from collections import OrderedDict
from fractions import Fraction

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions.formats.unpickle import PickledArray, unpickle
from tests.motions.formats.writers import NumpyArrayWrapper, joblib_bytes


def plain(value):
    if isinstance(value, PickledArray):
        return value.value
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    return value


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_data_comes_back(protocol):
    arrays = {
        "c": np.arange(6, dtype=np.float32).reshape(2, 3),
        "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "big endian": np.arange(4, dtype=">f8"),
        "names": np.array(["left_knee", "é"]),
        "flags": np.array([True, False]),
        "scalar": np.float64(29.9),
    }
    others = OrderedDict(a=[1, -2, 2**70, 0.5, None, True], b=("x", b"y", []))
    found = plain(unpickle(pickle.dumps({**arrays, "others": others}, protocol)))
    assert found.pop("others") == others
    assert found.keys() == arrays.keys()
    for name, value in arrays.items():
        np.testing.assert_array_equal(found[name], value)


def test_names_of_numpy_1_are_known():
    data = pickle.dumps(np.arange(3), 2).replace(b"numpy._core", b"numpy.core")
    np.testing.assert_array_equal(plain(unpickle(data)), [0, 1, 2])


@pytest.mark.parametrize("aligned", [True, False])
def test_joblib_arrays_come_back(aligned):
    data = {"c": np.arange(6, dtype=np.float32).reshape(2, 3), "f": np.asfortranarray(np.eye(3)[:2]), "n": 30}
    found = plain(unpickle(joblib_bytes(data, aligned)))
    for name, value in data.items():
        np.testing.assert_array_equal(found[name], value)


class Runs:
    """Pickles into a call."""

    def __init__(self, function, *arguments):
        self._call = function, arguments

    def __reduce__(self):
        return self._call


class Persistent(pickle.Pickler):
    def persistent_id(self, obj):
        return "id" if obj == "secret" else None


def persistent() -> bytes:
    file = io.BytesIO()
    Persistent(file).dump("secret")
    return file.getvalue()


def text(value: str) -> bytes:
    return b"\x8c" + bytes([len(value)]) + value.encode()


def stack_global(module: str, name: str) -> bytes:
    return text(module) + text(name) + b"\x93"


def header(shape: tuple[int, ...], dtype: str = "f8") -> bytes:
    """A joblib wrapper that claims an array of that shape, with no bytes behind it."""
    wrapper = {"shape": shape, "order": "C", "dtype": np.dtype(dtype)}
    return (
        b"\x80\x04"
        + stack_global("joblib.numpy_pickle", NumpyArrayWrapper.__name__)
        + b")\x81"
        + pickle.dumps(wrapper, 4)[2:-1]
        + b"b."
    )


def copies() -> bytes:
    """One long string, encoded to bytes over and over: a small file that asks for gigabytes."""
    long = b"X" + struct.pack("<I", 10**6) + b"a" * 10**6 + b"q\x00"
    encode = b"c_codecs\nencode\nq\x01X\x06\x00\x00\x00latin1q\x02"
    return b"\x80\x02" + long + encode + b"h\x01h\x00h\x02\x86R" * 10**5 + b"."


def laughs(close: str) -> bytes:
    """Twenty tuples or lists, each with the one before ten times: 10^20 entries for whoever walks through them."""
    levels = (b"(" + b"h%c" % level * 10 + b"%sq%c" % (close.encode(), level + 1) for level in range(20))
    return b")q\x00" + b"".join(levels)


MALICIOUS = {
    "a call": (pickle.dumps(Runs(os.system, "echo run")), "names 'posix.system'|names 'nt.system'"),
    "a call in an old protocol": (pickle.dumps(Runs(os.system, "echo run"), 0), r"names '(posix|nt)\.system'"),
    "eval": (b"cbuiltins\neval\n(X\x01\x00\x00\x001tR.", "names 'builtins.eval'"),
    "getattr": (pickle.dumps(Runs(getattr, "a", "upper")), "names 'builtins.getattr'"),
    "a path through a known module": (
        b"\x80\x04" + stack_global("numpy", "ndarray.tofile") + b".",
        "names 'numpy.ndarray.tofile'",
    ),
    "a known name of another module": (b"\x80\x04" + stack_global("os", "dtype") + b".", "names 'os.dtype'"),
    "an instance": (pickle.dumps(Fraction(1, 2)), "names 'fractions.Fraction'"),
    "an old instance": (b"(X\x02\x00\x00\x00lsios\nsystem\n.", "opcode INST"),
    "an object": (b"(cnumpy\nndarray\no.", "opcode OBJ"),
    "keyword arguments": (b"\x80\x04cnumpy\nndarray\n)}\x92.", "opcode NEWOBJ_EX"),
    "an array made by its class": (b"\x80\x02cnumpy\nndarray\n(J\xff\xff\xff\x7ftR.", "calls 'ndarray'"),
    "a registered extension": (b"\x82\x01.", "opcode EXT1"),
    "a persistent id": (persistent(), "opcode BINPERSID"),
    "an out of band buffer": (b"\x80\x05\x97.", "opcode NEXT_BUFFER"),
    "an array of objects": (pickle.dumps(np.array([{}], dtype=object)), "array of type 'O8'"),
    "a state of a list": (b"]}b.", "sets the state of a list"),
    "a function called with a list": (b"cnumpy\ndtype\n]R.", "has a list where a tuple belongs"),
    "a call of a string": (b"X\x01\x00\x00\x00a)R.", "has a str where a Name belongs"),
    "a key that is not data": (b"}]K\x01s.", "key of type list"),
    "numbers that collide": (pickle.dumps({(2**61 - 1) * 3: 1}), "key of type int"),
    "copies without end": (copies(), "several times larger than it is"),
    "a huge array": (header((10**6, 10**6)), "shape does not fit"),
    "a negative array": (header((-1, 5)), "shape does not fit"),
    "a shape of giants": (header((2 ** (8 * 10**5),) * 3), "shape does not fit"),
    "a type that is no name": (b"cnumpy\ndtype\n(]tR.", "has a list where a str belongs"),
    "a module that is no name": (
        b"\x80\x04" + laughs("t") + text("dtype") + b"\x93.",
        "has a tuple where a str belongs",
    ),
    "containers alone": (b"]" * 10**5 + b"a" * (10**5 - 1) + b".", "several times larger than it is"),
    "tuples alone": (b"(" * 10**5 + b"t" * 10**5 + b".", "several times larger than it is"),
    "no end": (pickle.dumps([1])[:-1], "exhausted"),
}


@pytest.mark.parametrize("case", MALICIOUS)
def test_more_than_data_is_refused_and_never_run(case, monkeypatch):
    def fail(*_):
        raise AssertionError("something was run")

    monkeypatch.setattr("os.system", fail)
    monkeypatch.setattr("builtins.eval", fail)
    data, message = MALICIOUS[case]
    with pytest.raises(ValueError, match=message) as caught:
        unpickle(data)
    assert case == "no end" or isinstance(caught.value, MotionError)


def test_an_array_larger_than_its_bytes_is_refused():
    good = pickle.dumps(np.zeros((2, 3)), 4)
    with pytest.raises(ValueError, match="cannot reshape"):
        unpickle(good.replace(b"K\x02K\x03", b"K\xffK\xff"))


@pytest.mark.parametrize(
    "data",
    [b"]" * 1000 + b"a" * 999 + b".", b"(" * 1000 + b"t" * 1000 + b".", laughs("t") + b".", laughs("l") + b"."],
    ids=["deep lists", "deep tuples", "wide tuples", "wide lists"],
)
def test_containers_of_containers_do_no_harm(data):
    assert isinstance(unpickle(data), (list, tuple))


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_numbers_may_be_objects(protocol):
    numbers = np.arange(6.0).reshape(2, 3)
    for array in (numbers, np.asfortranarray(numbers), numbers.T, numbers[:, ::-1], np.array([1, 2.5]), numbers[:0]):
        found = unpickle(pickle.dumps(array.astype(object), protocol)).value
        assert found.dtype == np.float64 or found.size == 0
        np.testing.assert_array_equal(found.ravel(), array.ravel())
        assert found.shape == array.shape or found.size == 0
    with pytest.raises(MotionError, match="array of type 'O8'"):
        unpickle(pickle.dumps(np.array([True, 1.0], dtype=object), protocol))
