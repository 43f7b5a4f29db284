"""What an environment remembers: the plain attributes of it, its wrappers and its own objects, found and put back.

Every state that is taken or put needs this walk, so what a value's type says is found once per type, and names and
paths of an object's attributes once per set of names.
"""

from __future__ import annotations

import types
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.errors import ConfigError
from p2l.worlds.gymnasium.snapshot import ALWAYS_PLAIN, is_plain

OWN = "env"
_FOREIGN = (
    "numpy", "mujoco", "builtins", "threading", "logging", "collections", "xml", "matplotlib", "PIL", "glfw", "OpenGL",
    "pathlib", "random", "abc", "functools", "typing", "enum", "gymnasium.spaces", "gymnasium.envs.registration",
    "gymnasium.envs.mujoco.mujoco_rendering", "robosuite.utils.binding_utils", "robosuite.models.arenas",
    "robosuite.models.objects", "robosuite.models.tasks", "robosuite.models.robots", "robosuite.models.bases",
)  # fmt: skip
_CODE = (type, types.ModuleType, types.FunctionType, types.MethodType, types.BuiltinFunctionType)
_SCREEN = ("viewer", "renderer", "mujoco_renderer", "_viewers", "_render_context_offscreen", "render_context")
_LEAF, _ASK, _OBJECT, _FOREIGNER = range(4)  # what a type says: a leaf; a leaf if it is plain; an own object; neither
Names = tuple[tuple[str, Any], ...]


class Leaves:
    """The plain attributes of environments that one `make_env` makes."""

    def __init__(self) -> None:
        self._types: dict[type, int] = {}
        self._names: dict[str, tuple[tuple[Any, ...], Names]] = {}

    def walk(self, env: Any) -> Iterator[tuple[str, Any, Any, Any]]:
        """Path, owner, key and value of each, each object once.

        In an order that does not depend on when attributes were made, so that a shared object has the same path
        everywhere.
        """
        seen: set[int] = set()
        waiting: deque[tuple[str, Any]] = deque([(OWN, env)])
        while waiting:
            path, owner = waiting.popleft()
            if id(owner) in seen:
                continue
            seen.add(id(owner))
            items = owner if isinstance(owner, (dict, list, tuple)) else vars(owner)
            can_be_set = not isinstance(owner, tuple)
            for place, key in self._names_of(path, items, is_dict=isinstance(owner, dict)):
                value = items[key]
                says = self._types.get(type(value))
                if says is None:
                    says = self._types[type(value)] = _said_by_type(value)
                if says == _ASK:
                    says = _LEAF if _is_leaf(value) else _OBJECT if _is_own(value) else _FOREIGNER
                if says == _LEAF:
                    if can_be_set and isinstance(key, (str, int)):
                        yield place, owner, key, value
                elif says == _OBJECT:
                    waiting.append((place, value))

    def get(self, env: Any) -> dict[str, Any]:
        """Values by path; of named tuples their parts."""
        return {path: tuple(value) if _is_named_tuple(value) else value for path, _, _, value in self.walk(env)}

    def put(self, env: Any, values: Mapping[str, Any]) -> None:
        """Make an environment's leaves what `get` gave.

        Raises:
            ConfigError: it has other objects inside than the one that they were taken from.
        """
        left = dict(values)
        for path, owner, key, present in list(self.walk(env)):
            if path in left:
                _put(owner, key, present, left.pop(path))
            elif isinstance(key, str) and not isinstance(owner, (dict, list)):
                delattr(owner, key)
        for path, value in left.items():  # an attribute that this one does not have yet
            place, _, name = path.rpartition(".")
            owner = _object_at(env, place)
            if owner is None:
                raise ConfigError(f"state field '{path}': this environment has no '{place}'")
            _put(owner, name, _at(owner, name), value)

    def _names_of(self, path: str, items: Any, *, is_dict: bool) -> Names:
        """Paths and keys of what an object holds, in order."""
        keys = tuple(items) if isinstance(items, dict) else (len(items),)
        known = self._names.get(path)
        if known is None or known[0] != keys:
            if not isinstance(items, dict):
                order = list(range(len(items)))
            else:
                order = [key for key in sorted(items, key=str) if is_dict or key not in _SCREEN]
            known = self._names[path] = (keys, tuple((f"{path}.{key}", key) for key in order))
        return known[1]


def _said_by_type(value: Any) -> int:
    if isinstance(value, ALWAYS_PLAIN):
        return _LEAF
    if isinstance(value, (np.ndarray, dict, list, tuple, set, frozenset, deque)):
        return _ASK
    return _OBJECT if _is_own(value) else _FOREIGNER


def _is_leaf(value: Any) -> bool:
    return is_plain(value) or (_is_named_tuple(value) and is_plain(tuple(value)))


def _is_own(value: Any) -> bool:
    """Whether an object is the environment's own, so that what it remembers is part of the state."""
    if isinstance(value, (dict, list, tuple)):
        return True
    if isinstance(value, _CODE):
        return False
    module = type(value).__module__
    return hasattr(value, "__dict__") and not any(module == name or module.startswith(f"{name}.") for name in _FOREIGN)


def _is_named_tuple(value: Any) -> bool:
    return isinstance(value, tuple) and hasattr(value, "_make")


def _put(owner: Any, key: Any, present: Any, value: Any) -> None:
    """Set a leaf; an array that is a window on something else (MuJoCo's data) was restored with that."""
    if isinstance(present, np.ndarray):
        if _is_window(present):
            return
    elif isinstance(present, tuple):
        if hasattr(present, "_make") and len(value) == len(present):
            value = present._make(value)  # a named one stays what it is
    elif isinstance(present, dict):
        if type(present) is not dict and isinstance(value, dict):
            present.clear()  # so does an ordered one, or one with defaults
            present.update(value)
            return
    elif isinstance(present, np.random.Generator) and isinstance(value, np.random.Generator):
        present.bit_generator.state = value.bit_generator.state  # others may share it
        return
    if isinstance(owner, (dict, list)):
        owner[key] = value
    else:
        setattr(owner, key, value)


def _is_window(array: npt.NDArray[Any]) -> bool:
    """Whether an array shows memory of something that is no array, as those of MuJoCo's data do."""
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    return base is not None


def _at(owner: Any, key: Any) -> Any:
    """What is there under a key; None if nothing is."""
    if isinstance(owner, dict):
        return owner.get(key)
    return owner[key] if isinstance(owner, list) else getattr(owner, key, None)


def _object_at(env: Any, path: str) -> Any:
    owner: Any = env
    for name in path.split(".")[1:]:
        if isinstance(owner, dict):
            owner = next((value for key, value in owner.items() if str(key) == name), None)
        elif isinstance(owner, (list, tuple)):
            owner = owner[int(name)] if int(name) < len(owner) else None
        else:
            owner = getattr(owner, name, None)
        if owner is None:
            return None
    return owner
