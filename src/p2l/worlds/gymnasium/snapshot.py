"""Plain values as bytes and back, without pickle: what a row keeps of an environment.

Numbers, strings, None, arrays, generators of numpy, and lists, tuples, sets and dictionaries of these. Numbers and
structure are JSON, arrays follow it byte by byte, so that what is read is what was written, to the bit.
"""

from __future__ import annotations

import json
import struct
from collections import OrderedDict, deque
from collections.abc import Iterable, Mapping
from functools import lru_cache
from json.encoder import encode_basestring_ascii as _quoted
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.errors import ShapeError

_HEADER = struct.Struct("<QQ")  # lengths of the structure and of the arrays
_ALIGN = 8
_PADDING = tuple(b"\0" * count for count in range(_ALIGN))
_SCALARS = (bool, int, str, type(None))
_KEPT = frozenset("biufcSU")  # kinds of arrays' dtypes
ALWAYS_PLAIN = (*_SCALARS, float, bytes, np.generic, np.random.Generator, np.random.RandomState)


def is_plain(value: object) -> bool:
    """Whether `pack` takes a value."""
    if isinstance(value, ALWAYS_PLAIN):
        return True
    if isinstance(value, np.ndarray):
        return value.dtype.kind in _KEPT or (value.dtype == object and all(is_plain(each) for each in value.flat))
    if isinstance(value, tuple) and type(value) is not tuple:
        return False  # a named one has to stay what it is, see `leaves`
    if isinstance(value, (list, tuple, set, frozenset, deque)):
        return all(is_plain(each) for each in value)
    return isinstance(value, dict) and all(is_plain(key) and is_plain(each) for key, each in value.items())


def pack(fields: Mapping[str, Any]) -> bytes:
    """Fields by name as bytes.

    Raises:
        ShapeError: a value that is not plain; the message names its field.
    """
    arrays: list[npt.NDArray[Any]] = []
    texts = []
    for name, value in fields.items():
        try:
            texts.append(f"{_quoted(name)}:{_text(value, arrays)}")
        except TypeError as error:
            raise ShapeError(f"state field '{name}': {error}") from None
    head = f"{{{','.join(texts)}}}".encode()
    head += b" " * (-len(head) % _ALIGN)
    parts = [_HEADER.pack(len(head), sum(-(-array.nbytes // _ALIGN) * _ALIGN for array in arrays)), head]
    for array in arrays:
        parts += [array.tobytes(), _PADDING[-array.nbytes % _ALIGN]]
    return b"".join(parts)


def unpack(packed: bytes | memoryview) -> dict[str, Any]:
    """What `pack` was given; whatever follows it is ignored."""
    view = memoryview(packed)
    head, _ = _HEADER.unpack_from(view)
    body = _Body(view, _HEADER.size + head)
    plain = json.loads(str(view[_HEADER.size : _HEADER.size + head], "ascii"))
    return {name: _value(each, body) if type(each) is list else each for name, each in plain.items()}


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
        array: npt.NDArray[Any] = np.ndarray(tuple(shape), dtype, self._view, self._at).copy()
        self._at += array.nbytes + (-array.nbytes % _ALIGN)
        return array


def _text(value: Any, arrays: list[npt.NDArray[Any]]) -> str:
    """JSON: scalars as they are, everything else as [kind, …]; arrays are put aside. What is most common comes first.

    Raises:
        TypeError: it is not plain.
    """
    kind = type(value)
    if kind is float:
        return f'["f","{value.hex()}"]'
    if kind is np.ndarray:
        return _array_text("a", value, arrays)
    if value is None:
        return "null"
    if kind is bool:
        return "true" if value else "false"
    if isinstance(value, np.generic):
        return _array_text("g", np.asarray(value), arrays)
    if isinstance(value, int):
        return int.__repr__(value)
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, float):
        return f'["f","{value.hex()}"]'
    return _nested_text(value, arrays)


def _nested_text(value: Any, arrays: list[npt.NDArray[Any]]) -> str:
    if isinstance(value, np.ndarray):
        return _array_text("a", np.asarray(value), arrays)
    if isinstance(value, bytes):
        return f'["b","{value.hex()}"]'
    if isinstance(value, list):
        return f'["l",null,{_list_text(value, arrays)}]'
    if isinstance(value, tuple):
        return f'["t",null,{_list_text(value, arrays)}]'
    if isinstance(value, deque):
        return f'["q",{_text(value.maxlen, arrays)},{_list_text(value, arrays)}]'
    if isinstance(value, (set, frozenset)):
        return f'["s",null,{_list_text(sorted(value, key=repr), arrays)}]'
    if isinstance(value, dict):
        items = ",".join([f"[{_text(key, arrays)},{_text(each, arrays)}]" for key, each in value.items()])
        return f'["{"D" if isinstance(value, OrderedDict) else "d"}",null,[{items}]]'
    if isinstance(value, np.random.Generator):
        made = value.bit_generator
        return f'["r","{type(made).__name__}",{_text(made.state, arrays)}]'
    if isinstance(value, np.random.RandomState):
        return f'["R",null,{_text(value.get_state(legacy=False), arrays)}]'
    raise TypeError(f"a {type(value).__name__} cannot be kept")


def _array_text(kind: str, array: npt.NDArray[Any], arrays: list[npt.NDArray[Any]]) -> str:
    if array.dtype.kind not in _KEPT:
        if array.dtype.kind == "O":
            shape = ",".join(map(str, array.shape))
            return f'["o",[{shape}],{_list_text(array.flat, arrays)}]'
        raise TypeError(f"an array of {array.dtype} cannot be kept")
    arrays.append(array)
    return _array_head(kind, array.dtype, array.shape)


@lru_cache(maxsize=4096)
def _array_head(kind: str, dtype: np.dtype[Any], shape: tuple[int, ...]) -> str:
    return f'["{kind}","{dtype.str}",[{",".join(map(str, shape))}]]'


def _list_text(values: Iterable[Any], arrays: list[npt.NDArray[Any]]) -> str:
    return f"[{','.join([_text(each, arrays) for each in values])}]"


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
        state = np.random.RandomState(np.random.MT19937(_Unseeded()))  # type: ignore[arg-type]
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


class _Unseeded(np.random.bit_generator.ISeedSequence):
    """For a generator whose state is set next: drawing a seed costs more than all else of a state."""

    def generate_state(self, n_words: int, dtype: Any = np.uint32) -> npt.NDArray[Any]:
        """Zeros."""
        return np.zeros(n_words, dtype)


def _generator(name: str, state: Any) -> np.random.Generator:
    made = getattr(np.random, name)(_Unseeded())
    made.state = state
    return np.random.Generator(made)
