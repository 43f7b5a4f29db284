"""Taking and putting the state of environments that run on MuJoCo: Gymnasium-Robotics, Meta-World, robosuite and alike.

A state is more than positions and velocities. Kept are: MuJoCo's full physics state with warm starts and mocap bodies;
what it derives from it, which lags the positions by one physics step and which controllers read before they step;
numbers of the model that a reset has moved (where a door stands); and every plain attribute of the environment, its
wrappers and its own objects: elapsed steps, goals, filters, controllers' targets, generators.

Contacts and constraint forces are not kept but computed anew, so an environment whose next step reads them before it
steps differs after restoring; the check at registration finds that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from p2l.errors import ConfigError
from p2l.records import IntArray
from p2l.worlds.gymnasium.leaves import OWN, Leaves

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
_PHYSICS, _DATA, _MODEL, _SAME = "physics", "data", "model.", "same"
_GAP = 128  # bytes between arrays that MuJoCo has laid side by side


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
        self._leaves = Leaves()
        self._windows = _Windows(model, data, self._reference, self._derived)

    def get(self, env: Any) -> dict[str, Any]:
        """Fields of the state by name."""
        model, data = mujoco_of(env)
        windows = self._windows_on(model, data)
        physics = np.empty(windows.physics)
        mujoco.mj_getState(model, data, physics, _STATE)
        fields: dict[str, Any] = {_PHYSICS: physics, _DATA: windows.derived.take(windows.places)}
        for name in windows.moved():
            fields[_MODEL + name] = windows.numbers[name].copy()
        own = self._leaves.get(env)
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
        windows = self._windows_on(model, data)
        kept = {name.removeprefix(_MODEL): value for name, value in fields.items() if name.startswith(_MODEL)}
        for name in windows.moved():
            if name not in kept:
                value = windows.numbers[name]
                value[...] = np.frombuffer(self._reference[name], dtype=value.dtype).reshape(value.shape)
        for name, value in kept.items():
            windows.numbers[name][...] = value
        mujoco.mj_setState(model, data, fields[_PHYSICS], _STATE)
        mujoco.mj_forward(model, data)  # contacts, and whatever else is not kept
        mujoco.mj_setState(model, data, fields[_PHYSICS], _STATE)
        windows.derived[windows.places] = fields[_DATA]
        own = {path: value for path, value in fields.items() if path.startswith(f"{OWN}.")}
        own |= {path: own[at] for path, at in fields[_SAME].items()}  # one array under two names stays one
        self._leaves.put(env, own)

    def _windows_on(self, model: mujoco.MjModel, data: mujoco.MjData) -> _Windows:
        if self._windows.model is not model or self._windows.data is not data:
            self._windows = _Windows(model, data, self._reference, self._derived)
        return self._windows


class _Windows:
    """MuJoCo's own arrays of one model and its data, and few large ones on the same memory, which are read at once.

    Attributes:
        numbers: of the model, by name.
        physics: numbers of the physics state.
        derived: everything from the first to the last number that is derived; never read but at `places`.
        places: of these numbers in it, in the order of their names.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, reference: Mapping[str, bytes], derived: Sequence[str]
    ) -> None:
        self.model, self.data = model, data
        self.numbers: dict[str, Numbers] = {name: getattr(model, name) for name in reference}
        self.physics = mujoco.mj_stateSize(model, _STATE)
        self._order = {name: place for place, name in enumerate(reference)}
        self._stretches = [_stretch(group, reference) for group in _side_by_side(self.numbers)]
        parts = [getattr(data, name) for name in derived]
        start = min(map(_address, parts))
        size = max(_address(part) + part.nbytes for part in parts) - start
        self.derived = _memory(min(parts, key=_address), size).view(np.float64)
        self.places = np.concatenate([(_address(part) - start) // 8 + np.arange(part.size) for part in parts])

    def moved(self) -> list[str]:
        """Names of the model's numbers that are not as in the reference."""
        found: set[str] = set()
        for memory, wanted, names, owner in self._stretches:
            if (where := np.flatnonzero(memory != wanted)).size:
                found |= {names[place] for place in set(owner[where].tolist()) if place >= 0}
        return sorted(found, key=self._order.__getitem__)


def _address(array: Numbers) -> int:
    return int(array.__array_interface__["data"][0])


def _memory(first: Numbers, size: int) -> npt.NDArray[np.uint8]:
    """[size] bytes from the first of an array on; the array's owner stays alive with them."""
    return np.lib.stride_tricks.as_strided(first.reshape(-1).view(np.uint8), (size,), (1,))


def _side_by_side(arrays: Mapping[str, Numbers]) -> list[dict[str, Numbers]]:
    """Arrays in the order of their addresses, those together that are at most `_GAP` apart."""
    groups: list[dict[str, Numbers]] = []
    end = 0
    for name, array in sorted(arrays.items(), key=lambda item: _address(item[1])):
        if not groups or _address(array) > end + _GAP:
            groups.append({})
        groups[-1][name] = array
        end = _address(array) + array.nbytes
    return groups


def _stretch(
    group: Mapping[str, Numbers], reference: Mapping[str, bytes]
) -> tuple[Numbers, Numbers, list[str], IntArray]:
    """Arrays side by side as one of words, what the reference holds there, their names, and whose a word is or −1.

    Words are as wide as the places of the arrays allow, for speed: none belongs to two of them.
    """
    arrays = list(group.values())
    start, end = _address(arrays[0]), _address(arrays[-1]) + arrays[-1].nbytes
    word = math.gcd(8, end - start, *(_address(array) - start for array in arrays))
    memory = _memory(arrays[0], end - start)
    wanted, owner = memory.copy(), np.full(len(memory), -1, dtype=np.int64)
    for place, (name, array) in enumerate(group.items()):
        where = slice(_address(array) - start, _address(array) - start + array.nbytes)
        wanted[where], owner[where] = np.frombuffer(reference[name], dtype=np.uint8), place
    dtype = f"u{word}"
    return memory.view(dtype), wanted.view(dtype), list(group), owner[::word].copy()


def _numbers(model: mujoco.MjModel) -> list[str]:
    """Fields of a model that a reset may change."""
    names = [name for name in dir(model) if name.startswith(_MOVABLE)]
    return [name for name in names if isinstance(getattr(model, name), np.ndarray) and getattr(model, name).size]
