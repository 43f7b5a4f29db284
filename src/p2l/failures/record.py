"""Moments of failure, complete enough to go on from, each with the simulator's truth and the robot's observation.

Axis letters: N failures. Training and held-out failures are two records with different seeds; a record holds one
split and says which, so that the two are never mixed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from p2l.artifacts import load_arrays, save_arrays
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ArtifactError, ConfigError, ShapeError
from p2l.records import Array, BoolArray, IntArray, freeze
from p2l.worlds.table import make_world

SCHEMA, VERSION = "failures", 1
SPLITS = ("train", "held_out")
STRANDED = "stranded"  # no detector spoke: no option can start here, and the task is not done
_COUNTS = ("option", "kind", "step", "episode")
ColumnsT = TypeVar("ColumnsT", Privileged, Observation)


@dataclass(frozen=True)
class Origin:
    """Where failures come from, enough to build their world and to sample their episodes again.

    Attributes:
        world: registered name, or target of a world that is not ours.
        params: of the world, plain values; the strategy's estimator among them.
        digest: of the world; a row of another digest means something else.
        strategy: of discovery.
        split: one of `SPLITS`.
        seed: of the whole split.
        executions: episodes that were run.
        max_options: options of an episode under early termination.
        options: names of the nominal chain.
        kinds: names of kinds of failure: the detectors', then `STRANDED`.
    """

    world: str
    params: Mapping[str, Any]
    digest: str
    strategy: str
    split: str
    seed: int
    executions: int
    max_options: int
    options: tuple[str, ...]
    kinds: tuple[str, ...]


@dataclass(frozen=True)
class Failures:
    """N moments of failure of one split.

    Attributes:
        origin: where they come from.
        start: [N] how the failure's episode started; running the chain from here leads to the failure again.
        rows: [N] the moment of failure.
        truth: [N] privileged state then.
        seen: [N] observation then; it errs as the robot's estimate did.
        option: [N] which option failed, index into `origin.options`.
        kind: [N] index into `origin.kinds`.
        step: [N] control step of the episode.
        time_s: [N] the same in seconds.
        episode: [N] number of the episode; an episode that goes on after failing leaves several.
    """

    origin: Origin
    start: Rows
    rows: Rows
    truth: Privileged
    seen: Observation
    option: IntArray
    kind: IntArray
    step: IntArray
    time_s: Array
    episode: IntArray

    def __post_init__(self) -> None:
        sizes = {"N": len(self.rows)}
        for name in _COUNTS:
            object.__setattr__(self, name, freeze(name, getattr(self, name), ("N",), sizes, np.int64, low=0))
        object.__setattr__(self, "time_s", freeze("time_s", self.time_s, ("N",), sizes, low=0.0))
        for name, source in (("truth", self.truth), ("seen", self.seen)):
            freeze(name, source.values, ("N", "C"), {"N": sizes["N"]})
        if len(self.start) != sizes["N"]:
            raise ShapeError(f"failures: {len(self.start)} starts of {sizes['N']} failures")
        for name, names in (("option", self.origin.options), ("kind", self.origin.kinds)):
            if len(self) and getattr(self, name).max() >= len(names):
                raise ShapeError(f"failures: {name} holds {getattr(self, name).max()}; there are {len(names)}")

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, index: IntArray | BoolArray | Sequence[int]) -> Failures:
        """The failures of `index`."""
        where = np.asarray(index)
        where = where if where.dtype == np.bool_ else where.astype(np.int64)  # an empty list has no integers
        parts: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        origin = parts.pop("origin")
        rest: dict[str, Any] = {
            name: part[where] if isinstance(part, np.ndarray) else part.take(where) for name, part in parts.items()
        }
        return Failures(origin, **rest)

    def kind_names(self) -> list[str]:
        """[N] names of the kinds."""
        return [self.origin.kinds[kind] for kind in self.kind]

    def option_names(self) -> list[str]:
        """[N] names of the options that failed."""
        return [self.origin.options[option] for option in self.option]


def save_failures(path: Path | str, failures: Failures) -> None:
    """Write a `.npz`."""
    arrays: dict[str, npt.NDArray[Any]] = {"origin": np.array(json.dumps(asdict(failures.origin), sort_keys=True))}
    for name in ("start", "rows"):
        arrays |= {f"{name}.{key}": value for key, value in getattr(failures, name).arrays().items()}
    for name in ("truth", "seen"):
        source: Privileged | Observation = getattr(failures, name)
        arrays[f"{name}.values"] = source.values
        arrays[f"{name}.fields"] = np.array(list(source.columns))
        arrays[f"{name}.widths"] = np.array([where.stop - where.start for where in source.columns.values()])
    arrays |= {name: getattr(failures, name) for name in (*_COUNTS, "time_s")}
    save_arrays(path, arrays, schema=SCHEMA, version=VERSION)


def load_failures(path: Path | str, split: str | None = None) -> Failures:
    """Read what `save_failures` wrote.

    Args:
        path: the file.
        split: refuse another one.

    Raises:
        ArtifactError: missing, truncated, damaged, of another version, or of the other split.
    """
    arrays = load_arrays(path, schema=SCHEMA, version=VERSION)
    content = json.loads(str(arrays["origin"]))
    origin = Origin(**{**content, "options": tuple(content["options"]), "kinds": tuple(content["kinds"])})
    if split is not None and origin.split != split:
        raise ArtifactError(f"{path}: holds the failures of split '{origin.split}'; expected '{split}'")
    rows: dict[str, Any] = {
        name: Rows.from_arrays({key[len(name) + 1 :]: arrays[key] for key in arrays if key.startswith(f"{name}.")})
        for name in ("start", "rows")
    }
    truth, observation = _columns(Privileged, arrays, "truth"), _columns(Observation, arrays, "seen")
    rest: dict[str, Any] = {name: arrays[name] for name in (*_COUNTS, "time_s")}
    return Failures(origin, truth=truth, seen=observation, **rows, **rest)


def open_world(failures: Failures, path: Path | str, nthread: int | None = None) -> tuple[World, tuple[Option, ...]]:
    """The world in which failures were found, with its nominal chain.

    Args:
        failures: of it.
        path: where they lie, for messages.
        nthread: simulator threads, which change no result; None: as many as found them.

    Raises:
        ArtifactError: the world has changed since.
        ConfigError: there is no such world any more.
    """
    world = varied_world(failures, nthread, {})
    check_world(failures, world, path)
    return world, world.nominal_options()


def varied_world(failures: Failures, nthread: int | None, differs: Mapping[str, Any]) -> World:
    """The world in which failures were found, with other values of some parameters.

    Args:
        failures: of it.
        nthread: simulator threads; None: as many as found them.
        differs: parameters with another value.

    Raises:
        ConfigError: the world refuses them.
    """
    threads = {} if nthread is None else {"nthread": nthread}
    return make_world(failures.origin.world, {**failures.origin.params, **threads, **differs})


def one_failure(failures: Failures, number: int, world: str, path: Path | str) -> Failures:
    """The failure of a number, counted from 0, of the world that is asked for.

    Raises:
        ConfigError: another world, or no such number.
    """
    if failures.origin.world != world:
        raise ConfigError(f"{path}: holds failures of '{failures.origin.world}', not of '{world}'")
    if number >= len(failures):
        raise ConfigError(f"failure={number}: {path} holds {len(failures)}, numbered from 0")
    return failures.take([number])


def check_params(failures: Failures, world: str, params: Mapping[str, Any], path: Path | str) -> None:
    """Refuse failures of another world or variant than the one asked for; the estimator is the strategy's.

    Raises:
        ArtifactError: another world, or another value of a parameter.
        ConfigError: the world does not take a parameter, or refuses its value.
    """
    origin = failures.origin
    if origin.world != world:
        raise ArtifactError(f"{path}: holds failures of world '{origin.world}'; expected those of '{world}'")
    names = sorted(({*params} | {*origin.params}) - {"estimator", "nthread"})
    if unlike := [name for name in names if params.get(name) != origin.params.get(name)]:
        if make_world(world, params).digest == origin.digest:
            return  # what is named here and not there has its default value
        values = [[each.get(name, "its default") for each in (origin.params, params)] for name in unlike]
        differences = "; ".join(
            f"{name} = {one}, not {other}" for name, (one, other) in zip(unlike, values, strict=True)
        )
        raise ArtifactError(
            f"{path}: found in another variant of world '{world}' ({differences}); discover them for this one"
        )


def check_pair(train: Failures, held_out: Failures, path: Path | str) -> None:
    """Refuse held-out failures that come from another world, strategy or seed than the training failures.

    Raises:
        ArtifactError: they do.
    """
    for name in ("world", "digest", "strategy", "seed"):
        mine, other = getattr(train.origin, name), getattr(held_out.origin, name)
        if mine != other:
            raise ArtifactError(f"{path}: has {name} {other}, the training failures {mine}; discover both in one run")


def check_world(failures: Failures, world: World, path: Path | str) -> None:
    """Refuse failures of another world: their rows would mean something else.

    Raises:
        ArtifactError: another name, other parameters, or another version of the world.
    """
    if failures.origin.world != world.name and ":" not in failures.origin.world:  # else the digest tells
        raise ArtifactError(f"{path}: holds failures of world '{failures.origin.world}', not of '{world.name}'")
    if failures.origin.digest != world.digest:
        raise ArtifactError(
            f"{path}: made with other parameters or another version of world '{world.name}' "
            f"({failures.origin.digest}, not {world.digest}); run `python -m stages.discover` again"
        )


def _columns(kind: type[ColumnsT], arrays: Mapping[str, npt.NDArray[Any]], name: str) -> ColumnsT:
    names = [str(field) for field in arrays[f"{name}.fields"]]
    edges = [0, *(int(edge) for edge in np.cumsum(arrays[f"{name}.widths"]))]
    columns = {field: slice(*edges[place : place + 2]) for place, field in enumerate(names)}
    return kind(columns, arrays[f"{name}.values"])
