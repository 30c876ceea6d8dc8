"""Reads the data in a pickle and never runs what else it says.

A pickle is a program for a small stack machine, and ``pickle.load`` lets that program import and call anything. Here it
is interpreted by code that knows only plain containers, numbers, strings and NumPy arrays. A name such as ``os.system``
is just a string, which it refuses. Nothing is imported or called on behalf of the file. The result takes at most a
small multiple of the file's memory, and nothing here walks through nested containers.

Source: the opcodes are those of ``pickletools``. joblib stores an array as a ``NumpyArrayWrapper`` that describes it,
followed in the stream by padding and the array's bytes.
"""

import io
import math
import pickletools
import re
from typing import Any

import numpy as np

from plat.errors import MotionError

__all__ = ["PickledArray", "unpickle"]

_INTEGERS = ("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4")
_TEXTS = ("STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8")
_BYTES = ("BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8")
_PUSH_ARGUMENT = frozenset((*_INTEGERS, "FLOAT", "BINFLOAT", *_TEXTS, *_BYTES))
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_SHORT_TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
# everything that a file of arrays names: numpy 1 says numpy.core, numpy 2 says numpy._core
_KNOWN_NAMES = frozenset(
    {
        ("numpy", "ndarray"),
        ("numpy", "dtype"),
        ("collections", "OrderedDict"),
        ("_codecs", "encode"),
        ("joblib.numpy_pickle", "NumpyArrayWrapper"),
        *(
            (f"numpy.{core}.{module}", name)
            for core in ("core", "_core")
            for module, name in (("multiarray", "_reconstruct"), ("multiarray", "scalar"), ("numeric", "_frombuffer"))
        ),
    }
)
# what makes a container, and about how many bytes an empty one takes
_CONTAINERS = frozenset(("MARK", "EMPTY_LIST", "EMPTY_TUPLE", "EMPTY_DICT", "REDUCE", "NEWOBJ", *_SHORT_TUPLES))
_CONTAINER_SIZE = 64
_DTYPE = re.compile(r"b1|[iu][1248]|f[248]|[SU]\d{1,4}")
_OBJECTS = ("O8", "O4")


class PickledArray:
    """A NumPy array of a pickle; ``value`` is None until the file has given its content.

    An array of objects that holds one dictionary, as ``np.save`` makes it, has that for its value.
    """

    value: Any = None


class _Name(str):
    """Something that the file names and this module acts out."""


class _DType:
    def __init__(self, code: str):
        if not _DTYPE.fullmatch(_expect(code, str)) and code not in _OBJECTS:
            raise MotionError(f"it holds an array of type {code!r}, expected numbers or strings")
        self.code, self.order = code, "="

    @property
    def numpy(self) -> np.dtype:
        return np.dtype(self.order + self.code)


def unpickle(data: bytes) -> Any:
    """Return the object in a pickle (any protocol, plain or by joblib), its arrays as :class:`PickledArray`.

    Raises:
        MotionError: when the pickle names anything but arrays and plain data, with that name.
        Exception: of many kinds when the pickle is broken; the caller takes them all for that.

    >>> import pickle
    >>> unpickle(pickle.dumps({"fps": 30, "dof_pos": np.zeros((2, 29))}))["dof_pos"].value.shape
    (2, 29)
    >>> unpickle(pickle.dumps(print))
    Traceback (most recent call last):
    plat.errors.MotionError: it names 'builtins.print', expected arrays, plain containers, numbers and strings alone
    """
    return _Machine(data).run()


class _Machine:
    def __init__(self, data: bytes):
        self._file = io.BytesIO(data)
        self._size = len(data)
        # bytes that may still be made: without a limit one opcode could be a large object, or a copy of a long string
        self._spare = 4 * len(data) + (1 << 16)
        self._stack: list[Any] = []
        self._marks: list[list[Any]] = []
        self._memo: dict[int, Any] = {}

    def run(self) -> Any:
        for opcode, argument, _ in pickletools.genops(self._file):
            if opcode.name == "STOP":
                if self._file.read().strip(b"\0\r\n "):
                    raise MotionError("it goes on behind its first object, expected one: a dictionary of all motions")
                return self._stack.pop()
            self._do(opcode.name, argument)
        raise MotionError("it ends too early")

    def _do(self, opcode: str, argument: Any) -> None:
        stack = self._stack
        if opcode in _CONTAINERS:
            self._claim(_CONTAINER_SIZE)
        if opcode in _PUSH_ARGUMENT:
            stack.append(argument)
        elif opcode in _CONSTANTS:
            stack.append(_CONSTANTS[opcode])
        elif opcode in ("MEMOIZE", "PUT", "BINPUT", "LONG_BINPUT"):
            self._memo[len(self._memo) if opcode == "MEMOIZE" else argument] = stack[-1]
        elif opcode in ("GET", "BINGET", "LONG_BINGET"):
            stack.append(self._memo[argument])
        elif opcode == "MARK":
            self._marks.append(stack)
            self._stack = []
        elif opcode in ("EMPTY_LIST", "LIST"):
            self._push_or_close(opcode, list)
        elif opcode in ("EMPTY_TUPLE", "TUPLE"):
            self._push_or_close(opcode, tuple)
        elif opcode in _SHORT_TUPLES:
            count = _SHORT_TUPLES[opcode]
            stack[-count:] = [tuple(stack[-count:])]
        elif opcode in ("EMPTY_DICT", "DICT"):
            self._push_or_close(opcode, lambda items: _fill({}, items))
        elif opcode in ("APPEND", "APPENDS"):
            items = [stack.pop()] if opcode == "APPEND" else self._close()
            _expect(self._stack[-1], list).extend(items)
        elif opcode in ("SETITEM", "SETITEMS"):
            items = [stack.pop(-2), stack.pop()] if opcode == "SETITEM" else self._close()
            _fill(_expect(self._stack[-1], dict), items)
        elif opcode in ("GLOBAL", "STACK_GLOBAL"):
            pair = argument.split(" ", 1) if opcode == "GLOBAL" else [stack.pop(-2), stack.pop()]
            stack.append(_name(*pair))
        elif opcode in ("REDUCE", "NEWOBJ"):
            arguments = _expect(stack.pop(), tuple)
            stack.append(self._make(_expect(stack.pop(), _Name), arguments))
        elif opcode == "BUILD":
            state = stack.pop()
            self._set_state(stack[-1], state)
        elif opcode == "POP":
            stack.pop()
        elif opcode not in ("PROTO", "FRAME"):
            raise MotionError(f"it uses the opcode {opcode}, which data does not need")

    def _close(self) -> list[Any]:
        """What stands above the last mark, which is taken away."""
        items, self._stack = self._stack, self._marks.pop()
        return items

    def _push_or_close(self, opcode: str, kind: Any) -> None:
        items = [] if opcode.startswith("EMPTY") else self._close()
        self._stack.append(kind(items))

    def _make(self, name: _Name, arguments: tuple[Any, ...]) -> Any:
        """Act out a call."""
        if name == "dtype":
            return _DType(arguments[0])
        if name == "OrderedDict" and not arguments:
            return {}
        if name == "encode":  # bytes in protocols below 3
            return self._bytes(arguments[0])
        if name in ("_reconstruct", "NumpyArrayWrapper"):
            return PickledArray()
        if name == "scalar":
            return self._array(arguments[0], (1,), "C", arguments[1]).item()
        if name == "_frombuffer":
            buffer, dtype, shape, order = arguments[:4]
            array = PickledArray()
            array.value = self._array(dtype, shape, order, buffer)
            return array
        raise MotionError(f"it calls {str(name)!r} in a way that data does not need")

    def _set_state(self, made: Any, state: Any) -> None:
        if isinstance(made, _DType):
            order = _expect(state, tuple)[1]
            made.order = order if order in ("<", ">", "=", "|") else "="
        elif isinstance(made, PickledArray) and isinstance(state, dict):
            made.value = self._joblib_array(state)
        elif isinstance(made, PickledArray):
            _, shape, dtype, fortran, raw = _expect(state, tuple)
            made.value = self._array(dtype, shape, "F" if fortran else "C", raw)
        else:
            raise MotionError(f"it sets the state of a {type(made).__name__}, which data does not need")

    def _joblib_array(self, state: dict[str, Any]) -> np.ndarray:
        """The array that stands next in the stream."""
        dtype, shape = _expect(state["dtype"], _DType), _expect(state["shape"], tuple)
        if state.get("numpy_array_alignment_bytes") is not None:
            self._file.seek(self._file.read(1)[0], io.SEEK_CUR)
        fits = len(shape) <= 4 and all(isinstance(length, int) and 0 <= length <= self._size for length in shape)
        size = math.prod(shape) * dtype.numpy.itemsize if fits else math.inf
        if size > self._size:
            raise MotionError("it has an array whose shape does not fit into it")
        return self._array(dtype, shape, state["order"], self._file.read(int(size)))

    def _array(
        self, dtype: _DType, shape: tuple[int, ...], order: str, raw: bytes | bytearray | str | list[Any]
    ) -> Any:
        if _expect(dtype, _DType).code in _OBJECTS:
            single = shape == () and isinstance(raw, list) and len(raw) == 1 and isinstance(raw[0], dict)
            return raw[0] if single else self._plain(raw, _expect(shape, tuple))
        if not isinstance(raw, (bytes, bytearray)):
            raw = self._bytes(raw)
        self._claim(len(raw))
        order = "F" if order == "F" else "C"
        return np.frombuffer(raw, dtype.numpy).reshape(_expect(shape, tuple), order=order)  # type: ignore[call-overload]

    def _plain(self, items: Any, shape: tuple[int, ...]) -> np.ndarray:
        """Return the array that an array of objects stands for: of texts, such as names of joints, or of numbers.

        It is empty for None alone.
        """
        if isinstance(items, list) and all(item is None for item in items):
            return np.zeros(0)
        if isinstance(items, list) and all(type(item) in (int, float) for item in items):
            self._claim(8 * len(items))
            return np.array(items, dtype=np.float64).reshape(shape)  # objects are listed row by row, whatever the order
        if not isinstance(items, list) or not all(isinstance(item, str) for item in items):
            raise MotionError("it holds an array of type 'O8' with Python objects, expected numbers or texts")
        self._claim(4 * len(items) * max(map(len, items), default=0))
        return np.array(items, dtype=np.str_)

    def _bytes(self, text: Any) -> bytes:
        self._claim(len(_expect(text, str)))
        return text.encode("latin1")

    def _claim(self, size: int) -> None:
        self._spare -= size
        if self._spare < 0:
            raise MotionError("what it makes is several times larger than it is")


def _expect(value: Any, kind: type) -> Any:
    if not isinstance(value, kind):
        raise MotionError(f"it has a {type(value).__name__} where a {kind.__name__.strip('_')} belongs")
    return value


def _name(module: Any, name: Any) -> _Name:
    # strings, or Python would walk through a tuple of tuples to compare it
    if (_expect(module, str), _expect(name, str)) not in _KNOWN_NAMES:
        raise MotionError(
            f"it names {f'{module}.{name}'!r}, expected arrays, plain containers, numbers and strings alone"
        )
    return _Name(name)


def _fill(target: dict[Any, Any], items: list[Any]) -> dict[Any, Any]:
    for key in items[::2]:
        # Python hashes large numbers to values that a file could choose to collide, strings not
        if not isinstance(key, str) and not (isinstance(key, int) and abs(key) < 2**31):
            raise MotionError(f"it has a dictionary key of type {type(key).__name__}, expected a string")
    target.update(zip(items[::2], items[1::2], strict=True))
    return target
