"""Taking and putting the state of environments that run on MuJoCo: Gymnasium-Robotics, Meta-World, robosuite and alike.

A state is more than positions and velocities. Kept are: MuJoCo's full physics state with warm starts and mocap bodies;
what it derives from it, which lags the positions by one physics step and which controllers read before they step;
numbers of the model that a reset has moved (where a door stands); and every plain attribute of the environment, its
wrappers and its own objects: elapsed steps, goals, filters, controllers' targets, generators.

Contacts and constraint forces are not kept but computed anew, so an environment whose next step reads them before it
steps differs after restoring; the check at registration finds that.
"""

from __future__ import annotations

import types
from collections import deque
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from p2l.errors import ConfigError
from p2l.worlds.gymnasium.snapshot import is_plain

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_DERIVED = (
    "xpos", "xquat", "xmat", "xipos", "ximat", "xanchor", "xaxis", "geom_xpos", "geom_xmat", "site_xpos", "site_xmat",
    "cam_xpos", "cam_xmat", "light_xpos", "light_xdir", "subtree_com", "subtree_linvel", "subtree_angmom", "cdof",
    "cdof_dot", "cinert", "crb", "cvel", "cacc", "cfrc_int", "cfrc_ext", "qM", "M", "qLD", "qLDiagInv", "qacc",
    "qacc_smooth", "qfrc_bias", "qfrc_passive", "qfrc_actuator", "qfrc_constraint", "qfrc_smooth", "qfrc_inverse",
    "qfrc_spring", "qfrc_damper", "qfrc_gravcomp", "qfrc_fluid", "act_dot", "actuator_force", "actuator_length",
    "actuator_velocity", "ten_length", "ten_velocity", "sensordata", "energy",
)  # fmt: skip
_MOVABLE = (
    "body_", "geom_", "site_", "jnt_", "dof_", "eq_", "actuator_", "cam_", "light_", "tendon_", "mat_", "pair_", "qpos",
)  # fmt: skip
_FOREIGN = (
    "numpy", "mujoco", "builtins", "threading", "logging", "collections", "xml", "matplotlib", "PIL", "glfw", "OpenGL",
    "pathlib", "random", "abc", "functools", "typing", "enum", "gymnasium.spaces", "gymnasium.envs.registration",
    "gymnasium.envs.mujoco.mujoco_rendering", "robosuite.utils.binding_utils", "robosuite.models.arenas",
    "robosuite.models.objects", "robosuite.models.tasks", "robosuite.models.robots", "robosuite.models.bases",
)  # fmt: skip
_SCREEN = ("viewer", "renderer", "mujoco_renderer", "_viewers", "_render_context_offscreen", "render_context")
_PHYSICS, _DATA, _MODEL, _OWN, _SAME = "physics", "data", "model.", "env", "same"


def mujoco_of(env: Any) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The model and data behind an environment.

    Raises:
        ConfigError: it is not known to run on MuJoCo.
    """
    inner = getattr(env, "unwrapped", env)
    for model, data in (("model", "data"), ("_model", "_data")):
        found = getattr(inner, model, None), getattr(inner, data, None)
        if isinstance(found[0], mujoco.MjModel) and isinstance(found[1], mujoco.MjData):
            return found[0], found[1]
    sim = getattr(inner, "sim", None)
    found = getattr(getattr(sim, "model", None), "_model", None), getattr(getattr(sim, "data", None), "_data", None)
    if isinstance(found[0], mujoco.MjModel) and isinstance(found[1], mujoco.MjData):
        return found[0], found[1]
    raise ConfigError(
        f"{type(inner).__name__}: no MuJoCo model and data were found in it; give the world `get_state(env)` and "
        "`set_state(env, state)`"
    )


Numbers = npt.NDArray[Any]


class MujocoState:
    """Takes and puts states of environments that one `make_env` makes.

    Args:
        env: one that has been reset with a fixed seed, so that its model is everyone's reference.
    """

    def __init__(self, env: Any) -> None:
        model, data = mujoco_of(env)
        self._reference = {name: getattr(model, name).tobytes() for name in _numbers(model)}
        self._derived = [name for name in _DERIVED if getattr(data, name, np.zeros(0)).size]
        ends = np.cumsum([0, *(getattr(data, name).size for name in self._derived)]).tolist()
        self._places = [slice(first, last) for first, last in pairwise(ends)]
        self._of: tuple[Any, Any] = (None, None)
        self._arrays: tuple[list[Numbers], list[Numbers]] = ([], [])

    def get(self, env: Any) -> dict[str, Any]:
        """Fields of the state by name."""
        model, data = mujoco_of(env)
        numbers, derived = self._windows(model, data)
        physics = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, physics, _STATE)
        fields: dict[str, Any] = {_PHYSICS: physics, _DATA: np.concatenate([part.reshape(-1) for part in derived])}
        for (name, reference), value in zip(self._reference.items(), numbers, strict=True):
            if value.tobytes() != reference:
                fields[_MODEL + name] = value.copy()
        own = {path: value_of(owner, key) for path, owner, key in _leaves(env)}
        first: dict[int, str] = {}
        arrays = [(path, value) for path, value in own.items() if isinstance(value, np.ndarray)]
        fields[_SAME] = {path: at for path, value in arrays if (at := first.setdefault(id(value), path)) != path}
        return fields | own

    def set(self, env: Any, fields: Mapping[str, Any]) -> None:
        """Put an environment into a state.

        Raises:
            ConfigError: it has other objects inside than the one that was taken from.
        """
        model, data = mujoco_of(env)
        numbers, derived = self._windows(model, data)
        for (name, reference), value in zip(self._reference.items(), numbers, strict=True):
            kept = fields.get(_MODEL + name)
            if kept is not None:
                value[...] = kept
            elif value.tobytes() != reference:
                value[...] = np.frombuffer(reference, dtype=value.dtype).reshape(value.shape)
        mujoco.mj_setState(model, data, fields[_PHYSICS], _STATE)
        mujoco.mj_forward(model, data)  # contacts, and whatever else is not kept
        mujoco.mj_setState(model, data, fields[_PHYSICS], _STATE)
        for part, where in zip(derived, self._places, strict=True):
            part[...] = fields[_DATA][where].reshape(part.shape)
        own = {path: value for path, value in fields.items() if path.startswith(f"{_OWN}.")}
        own |= {path: own[at] for path, at in fields[_SAME].items()}  # one array under two names stays one
        for path, owner, key in list(_leaves(env)):
            if path in own:
                _put(owner, key, own.pop(path))
            elif isinstance(key, str) and not isinstance(owner, (dict, list)):
                delattr(owner, key)
        for path, value in own.items():  # an attribute that this one does not have yet
            place, _, name = path.rpartition(".")
            owner = _object_at(env, place)
            if owner is None:
                raise ConfigError(f"state field '{path}': this environment has no '{place}'")
            _put(owner, name, value)

    def _windows(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[list[Numbers], list[Numbers]]:
        """MuJoCo's own arrays of the model's numbers and of what is derived; making them anew would take a third."""
        if self._of[0] is not model or self._of[1] is not data:
            numbers = [getattr(model, name) for name in self._reference]
            self._of, self._arrays = (model, data), (numbers, [getattr(data, name) for name in self._derived])
        return self._arrays


def _numbers(model: mujoco.MjModel) -> list[str]:
    """Fields of a model that a reset may change."""
    names = [name for name in dir(model) if name.startswith(_MOVABLE)]
    return [name for name in names if isinstance(getattr(model, name), np.ndarray) and getattr(model, name).size]


def value_of(owner: Any, key: Any) -> Any:
    """A leaf's value; of a named tuple its parts."""
    value = owner[key] if isinstance(owner, (dict, list)) else getattr(owner, key)
    return tuple(value) if _is_named_tuple(value) else value


def _is_named_tuple(value: Any) -> bool:
    return isinstance(value, tuple) and hasattr(value, "_make")


def _put(owner: Any, key: Any, value: Any) -> None:
    """Set a leaf; an array that is a window on something else (MuJoCo's data) was restored with that."""
    if isinstance(owner, (dict, list)):
        present = owner[key] if not isinstance(owner, dict) or key in owner else None
    else:
        present = getattr(owner, key, None)
    if isinstance(present, np.ndarray) and _is_window(present):
        return
    if isinstance(present, tuple) and hasattr(present, "_make") and len(value) == len(present):
        value = present._make(value)  # a named one stays what it is
    if isinstance(present, dict) and type(present) is not dict and isinstance(value, dict):
        present.clear()  # so does an ordered one, or one with defaults
        present.update(value)
        return
    if isinstance(present, np.random.Generator) and isinstance(value, np.random.Generator):
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


def _leaves(env: Any) -> Iterator[tuple[str, Any, Any]]:
    """Plain attributes of an environment and of its own objects: path, owner and key, each object once.

    In an order that does not depend on when attributes were made, so that a shared object has the same path everywhere.
    """
    seen: set[int] = set()
    waiting: deque[tuple[str, Any]] = deque([(_OWN, env)])
    while waiting:
        path, owner = waiting.popleft()
        if id(owner) in seen:
            continue
        seen.add(id(owner))
        for key, value in _items(owner):
            place = f"{path}.{key}"
            if is_plain(value) or (_is_named_tuple(value) and is_plain(tuple(value))):
                if _can_be_set(owner, key):
                    yield place, owner, key
            elif _is_own(value):
                waiting.append((place, value))


def _items(owner: Any) -> list[tuple[Any, Any]]:
    if isinstance(owner, dict):
        return sorted(owner.items(), key=lambda item: str(item[0]))
    if isinstance(owner, (list, tuple)):
        return list(enumerate(owner))
    return [(key, value) for key, value in sorted(vars(owner).items()) if key not in _SCREEN]


def _can_be_set(owner: Any, key: Any) -> bool:
    return not isinstance(owner, tuple) and isinstance(key, (str, int))


def _is_own(value: Any) -> bool:
    """Whether an object is the environment's own, so that what it remembers is part of the state."""
    if isinstance(value, (dict, list, tuple)):
        return True
    if isinstance(value, (type, types.ModuleType, types.FunctionType, types.MethodType, types.BuiltinFunctionType)):
        return False
    module = type(value).__module__
    return hasattr(value, "__dict__") and not any(module == name or module.startswith(f"{name}.") for name in _FOREIGN)


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
