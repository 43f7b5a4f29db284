"""How an environment's observations and actions lie in a row.

Axis letters: N rows, D numbers of an observation, E estimated coordinates, A numbers of an action.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from p2l.errors import ConfigError
from p2l.records import Array, IntArray

_PLACE = re.compile(r"(?P<key>.+?)(?:\[(?P<first>\d+)(?::(?P<last>\d+))?\])?")
_FLOAT = np.dtype(np.float64).str
BOX = "observation"  # the one part of an observation that is no dictionary


@dataclass(frozen=True)
class Noise:
    """An error of the robot's estimate of a part of the observation.

    Attributes:
        sigma: standard deviation of each coordinate at the start, in the observation's unit (m for a position).
        at: where the estimate is observed, e.g. `observation[3:6]` or `achieved_goal`; the same error goes to each, as
            a position and the same position relative to the hand err together.
    """

    sigma: float | Sequence[float]
    at: Sequence[str]


@dataclass(frozen=True)
class ObservationPart:
    """One array of an observation: its place in the flat one, shape and dtype."""

    where: slice
    shape: tuple[int, ...]
    dtype: str


@dataclass(frozen=True)
class Layout:
    """Where things are.

    Attributes:
        parts: of an observation, by key; `BOX` alone where it is one array.
        is_dict: whether it is a dictionary.
        size: D.
        action: shape of an action; () of a discrete one.
        actions: number of discrete actions, 0 of others.
        action_dtype: of an action, as the environment wants it.
    """

    parts: Mapping[str, ObservationPart]
    is_dict: bool
    size: int
    action: tuple[int, ...]
    actions: int
    action_dtype: str

    @classmethod
    def of(cls, observation: Any, action_space: Any) -> Layout:
        """From an observation and the space of actions.

        Raises:
            ConfigError: an observation that is neither an array nor a flat dictionary of arrays, or actions that are
                neither continuous (`Box`) nor discrete.
        """
        parts: dict[str, ObservationPart] = {}
        start = 0
        for key, value in (observation if isinstance(observation, dict) else {BOX: observation}).items():
            array = np.asarray(value)
            if array.dtype.kind not in "biuf":
                raise ConfigError(f"observation '{key}' is a {type(value).__name__}; p2l takes arrays of numbers")
            parts[str(key)] = ObservationPart(slice(start, start + array.size), array.shape, array.dtype.str)
            start += array.size
        if isinstance(action_space, gymnasium.spaces.Box):
            return cls(parts, isinstance(observation, dict), start, action_space.shape, 0, action_space.dtype.str)
        if isinstance(action_space, gymnasium.spaces.Discrete):
            return cls(parts, isinstance(observation, dict), start, (), int(action_space.n), "<i8")
        raise ConfigError(f"actions are a {type(action_space).__name__}; p2l takes a Box or a Discrete")

    @property
    def action_size(self) -> int:
        """A."""
        return int(np.prod(self.action, dtype=np.int64))

    @property
    def is_flat(self) -> bool:
        """Whether a flat observation [D] is one as the environment gives it."""
        return not self.is_dict and self.parts[BOX].dtype == _FLOAT and len(self.parts[BOX].shape) == 1

    def write(self, observation: Any, flat: Array) -> None:
        """Put an observation into `flat` [D].

        Raises:
            ValueError: it has another form than the first one.
        """
        if not self.is_dict:
            flat[:] = observation if getattr(observation, "ndim", 0) == 1 else np.reshape(observation, -1)
            return
        if len(observation) != len(self.parts):
            raise ValueError(f"it has the parts {', '.join(observation)}, not {', '.join(self.parts)}")
        for key, part in self.parts.items():
            flat[part.where] = np.reshape(observation[key], -1)

    def structure(self, flat: Array) -> Any:
        """The observation as the environment gives it, from [D], on whose memory it may lie."""
        if not self.is_dict:
            return _array(flat, self.parts[BOX])
        return {key: _array(flat, part) for key, part in self.parts.items()}

    def to_action(self, values: Array) -> Any:
        """What `env.step` takes, a copy, from [A]."""
        if self.actions:
            return int(values[0])
        action = values.astype(self.action_dtype)
        return action if len(self.action) == 1 else action.reshape(self.action)

    def place(self, text: str) -> slice:
        """Of a part of the flat observation, written `key`, `key[2]` or `key[2:5]`.

        Raises:
            ConfigError: there is no such part.
        """
        match = _PLACE.fullmatch(text)
        key = match["key"] if match else text
        if match is None or key not in self.parts:
            raise ConfigError(f"'{text}': the observation has no '{key}'; it has: {', '.join(self.parts)}")
        part = self.parts[key].where
        first = int(match["first"] or 0)
        last = int(match["last"]) if match["last"] else first + 1 if match["first"] else part.stop - part.start
        if not first < last <= part.stop - part.start:
            raise ConfigError(f"'{text}': '{key}' has {part.stop - part.start} numbers")
        return slice(part.start + first, part.start + last)

    def fields(self, named: Mapping[str, str]) -> dict[str, slice]:
        """Columns of the flat observation by name: those that a person has named, then all others by key.

        Raises:
            ConfigError: a name for something that there is not.
        """
        fields = {name: self.place(text) for name, text in named.items()}
        covered = np.zeros(self.size, dtype=np.bool_)
        for where in fields.values():
            covered[where] = True
        for key, part in self.parts.items():
            free = np.flatnonzero(~covered[part.where])
            for run in np.split(free, np.flatnonzero(np.diff(free) > 1) + 1) if len(free) else ():
                whole = len(run) == part.where.stop - part.where.start
                first, last = int(run[0]), int(run[-1]) + 1
                name = key if whole else f"{key}[{first}:{last}]"
                fields[name] = slice(part.where.start + first, part.where.start + last)
        return fields


@dataclass(frozen=True)
class NoiseMap:
    """Which error goes to which number of the observation.

    Attributes:
        sigma: [E].
        target: [T] places in the flat observation.
        source: [T] of the error that is added there.
        once: no place is a target twice.
    """

    sigma: tuple[float, ...]
    target: IntArray
    source: IntArray
    once: bool

    @classmethod
    def of(cls, layout: Layout, noise: Sequence[Noise]) -> NoiseMap:
        """From what a person has said.

        Raises:
            ConfigError: a part that there is not, or parts of different widths that are to err together.
        """
        sigma: list[float] = []
        target, source = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for each in noise:
            places = [np.arange(layout.size)[layout.place(text)] for text in each.at]
            widths = {len(place) for place in places}
            if len(widths) != 1:
                raise ConfigError(f"noise at {', '.join(each.at) or 'nothing'}: these must be as wide as each other")
            [width] = widths
            own = np.broadcast_to(np.asarray(each.sigma, dtype=np.float64), (width,))
            target += places
            source += [len(sigma) + np.arange(width)] * len(places)
            sigma += own.tolist()
        every = np.concatenate(target)
        return cls(tuple(sigma), every, np.concatenate(source), len(np.unique(every)) == len(every))

    def shift(self, error: Array, size: int) -> Array:
        """[…, D] what is added to the truth for the error […, E]; `size` is D."""
        shift = np.zeros((*error.shape[:-1], size))
        if self.once:
            shift[..., self.target] = error[..., self.source]
        else:
            for target, source in zip(self.target.tolist(), self.source.tolist(), strict=True):
                shift[..., target] += error[..., source]
        return shift


def _array(flat: Array, part: ObservationPart) -> npt.NDArray[Any]:
    array = flat[part.where]
    if part.dtype != _FLOAT:
        array = array.astype(part.dtype)
    return array if len(part.shape) == 1 else array.reshape(part.shape)
