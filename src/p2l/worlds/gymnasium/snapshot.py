"""Plain values as bytes and back, without pickle: what a row keeps of an environment.

Numbers, strings, None, arrays, generators of numpy, and lists, tuples, sets and dictionaries of these. Numbers and
structure are JSON, arrays follow it byte by byte, so that what is read is what was written, to the bit.
"""

from __future__ import annotations

import json
import math
import struct
from collections import OrderedDict, deque
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.errors import ShapeError

_HEADER = struct.Struct("<QQ")  # lengths of the structure and of the arrays
_ALIGN = 8
_SCALARS = (bool, int, str, type(None))
_SIMPLE = frozenset((*_SCALARS, float, np.float64, np.bool_, np.int64))


def is_plain(value: object) -> bool:
    """Whether `pack` takes a value."""
    if type(value) in _SIMPLE:
        return True
    if isinstance(value, (*_SCALARS, float, bytes, np.generic, np.random.Generator, np.random.RandomState)):
        return True
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "biufcSU" or (value.dtype == object and all(is_plain(each) for each in value.flat))
    if isinstance(value, tuple) and type(value) is not tuple:
        return False  # a named one has to stay what it is, see `physics`
    if isinstance(value, (list, tuple, set, frozenset, deque)):
        return all(is_plain(each) for each in value)
    return isinstance(value, dict) and all(is_plain(key) and is_plain(each) for key, each in value.items())


def pack(fields: Mapping[str, Any]) -> bytes:
    """Fields by name as bytes.

    Raises:
        ShapeError: a value that is not plain; the message names its field.
    """
    arrays: list[npt.NDArray[Any]] = []
    structure = {}
    for name, value in fields.items():
        try:
            structure[name] = _plain(value, arrays)
        except TypeError as error:
            raise ShapeError(f"state field '{name}': {error}") from None
    head = json.dumps(structure, separators=(",", ":")).encode()
    head += b" " * (-len(head) % _ALIGN)
    body = b"".join(array.tobytes() + b"\0" * (-array.nbytes % _ALIGN) for array in arrays)
    return _HEADER.pack(len(head), len(body)) + head + body


def unpack(packed: bytes | memoryview) -> dict[str, Any]:
    """What `pack` was given; whatever follows it is ignored."""
    view = memoryview(packed)
    head, _ = _HEADER.unpack_from(view)
    body = _Body(view, _HEADER.size + head)
    return {name: _value(plain, body) for name, plain in json.loads(bytes(view[_HEADER.size :][:head])).items()}


def differing_fields(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Names of fields that are not the same to the bit, or that only one of them has."""
    names = [*one, *(name for name in other if name not in one)]
    return [name for name in names if name not in one or name not in other or not _same(one[name], other[name])]


def _same(one: Any, other: Any) -> bool:
    return pack({"": one}) == pack({"": other})


class _Body:
    """The arrays behind the structure, one after the other."""

    def __init__(self, view: memoryview, start: int) -> None:
        self._view, self._at = view, start

    def array(self, dtype: str, shape: list[int]) -> npt.NDArray[Any]:
        """The next array, a copy."""
        kind = np.dtype(dtype)
        array = np.frombuffer(self._view, kind, math.prod(shape), self._at).reshape(shape).copy()
        self._at += array.nbytes + (-array.nbytes % _ALIGN)
        return array


def _plain(value: Any, arrays: list[npt.NDArray[Any]]) -> Any:
    """A JSON value: scalars as they are, everything else as [kind, …]; arrays are put aside."""
    if isinstance(value, _SCALARS) and not isinstance(value, np.generic):
        return value
    if isinstance(value, float) and not isinstance(value, np.generic):
        return ["f", value.hex()]
    if isinstance(value, (np.ndarray, np.generic)):
        array = np.asarray(value)
        if array.dtype == object:
            return ["o", list(array.shape), [_plain(each, arrays) for each in array.flat]]
        if array.dtype.kind not in "biufcSU":
            raise TypeError(f"an array of {array.dtype} cannot be kept")
        arrays.append(np.ascontiguousarray(array))
        return ["a" if isinstance(value, np.ndarray) else "g", array.dtype.str, list(array.shape)]
    if isinstance(value, bytes):
        return ["b", value.hex()]
    if isinstance(value, (list, tuple, deque)):
        kind = "l" if isinstance(value, list) else "t" if isinstance(value, tuple) else "q"
        extra = value.maxlen if isinstance(value, deque) else None
        return [kind, extra, [_plain(each, arrays) for each in value]]
    if isinstance(value, (set, frozenset)):
        return ["s", None, [_plain(each, arrays) for each in sorted(value, key=repr)]]
    if isinstance(value, dict):
        return [
            "D" if isinstance(value, OrderedDict) else "d",
            None,
            [[_plain(key, arrays), _plain(each, arrays)] for key, each in value.items()],
        ]
    if isinstance(value, np.random.Generator):
        return ["r", type(value.bit_generator).__name__, _plain(value.bit_generator.state, arrays)]
    if isinstance(value, np.random.RandomState):
        return ["R", None, _plain(value.get_state(legacy=False), arrays)]
    raise TypeError(f"a {type(value).__name__} cannot be kept")


def _value(plain: Any, body: _Body) -> Any:
    if not isinstance(plain, list):
        return plain
    kind, what, *rest = plain
    if kind == "f":
        return float.fromhex(what)
    if kind in "ag":
        array = body.array(what, rest[0])
        return array if kind == "a" else array[()]
    if kind == "b":
        return bytes.fromhex(what)
    if kind == "r":
        return _generator(what, _value(rest[0], body))
    if kind == "R":
        state = np.random.RandomState()
        state.set_state(_value(rest[0], body))
        return state
    if kind in "dD":
        items = [(_value(key, body), _value(each, body)) for key, each in rest[0]]
        return dict(items) if kind == "d" else OrderedDict(items)
    parts = [_value(each, body) for each in rest[0]]
    if kind == "o":
        array = np.empty(len(parts), dtype=object)
        array[:] = parts
        return array.reshape(what)
    made: dict[str, Any] = {"l": list, "t": tuple, "s": set}
    return deque(parts, what) if kind == "q" else made[kind](parts)


def _generator(name: str, state: Any) -> np.random.Generator:
    made = getattr(np.random, name)()
    made.state = state
    return np.random.Generator(made)
