"""Which mode a failure belongs to: a Gaussian mixture over interpretable features, kept as plain arrays.

Fitting is `clustering`'s; this module only evaluates, so that whoever recovers needs no scikit-learn. Modes are
numbered from the largest to the smallest.

Axis letters: N states, F features, K modes.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from p2l.artifacts import load_arrays, save_arrays
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.world import World
from p2l.errors import ArtifactError, ShapeError
from p2l.records import Array, IntArray, freeze

SCHEMA, VERSION = "failure_modes", 1
HAND = "grip_pos_m"
_NOT_OBJECTS = (HAND, "target_pos_m")


@dataclass(frozen=True)
class ModeClassifier:
    """The failure modes of a world.

    Attributes:
        world: registered name.
        digest: of the world whose failures were grouped.
        strategy: of discovery.
        fields: what the features are made of, see `features`.
        columns: F names of features, with units.
        centre: [F] subtracted from the features, then
        spread: [F] divides them.
        weights: [K] of the mixture.
        means: [K, F] of standardised features.
        covariances: [K, F, F].
        sizes: [K] training failures of each mode, |ρ_f| in the thesis's equation 4.2.
    """

    world: str
    digest: str
    strategy: str
    fields: tuple[str, ...]
    columns: tuple[str, ...]
    centre: Array
    spread: Array
    weights: Array
    means: Array
    covariances: Array
    sizes: IntArray

    def __post_init__(self) -> None:
        sizes = {"F": len(self.columns), "K": len(self.sizes)}
        shapes = {"centre": "F", "spread": "F", "weights": "K", "means": "KF", "covariances": "KFF"}
        for name, shape in shapes.items():
            object.__setattr__(self, name, freeze(name, getattr(self, name), tuple(shape), sizes))
        object.__setattr__(self, "sizes", freeze("sizes", self.sizes, ("K",), sizes, np.int64, low=0))

    def __len__(self) -> int:
        return len(self.sizes)

    @property
    def share(self) -> Array:
        """[K] |ρ_f| over their sum: how likely each mode is, given a failure."""
        return np.asarray(self.sizes / self.sizes.sum())

    def features(self, source: Privileged | Observation) -> Array:
        """[N, F] in the units of `columns`; an observation must have the same fields."""
        return features(source, self.fields)[1]

    def probability(self, source: Privileged | Observation) -> Array:
        """[N, K] probability of each mode; rows sum to 1."""
        log = self._log_joint((self.features(source) - self.centre) / self.spread)
        return np.asarray(np.exp(log - logsumexp(log, axis=1, keepdims=True)))

    def classify(self, source: Privileged | Observation) -> tuple[IntArray, Array]:
        """[N] the most probable mode, and [N] its probability."""
        probability = self.probability(source)
        mode = probability.argmax(axis=1)
        return mode, probability[np.arange(len(mode)), mode]

    def _log_joint(self, zscores: Array) -> Array:
        """[N, K] log of weight × density at standardised features [N, F]."""
        columns = []
        for weight, mean, covariance in zip(self.weights, self.means, self.covariances, strict=True):
            lower = np.linalg.cholesky(covariance)
            away = solve_triangular(lower, (zscores - mean).T, lower=True)
            volume = np.log(np.diag(lower)).sum() + 0.5 * len(mean) * np.log(2.0 * np.pi)
            columns.append(np.log(weight) - volume - 0.5 * (away**2).sum(axis=0))
        return np.stack(columns, axis=1)


def features(source: Privileged | Observation, names: Sequence[str]) -> tuple[tuple[str, ...], Array]:
    """Columns by name, F of them, and their values [N, F].

    Args:
        source: the truth, or an observation.
        names: fields, or `one - other` for the difference of two.

    Raises:
        ShapeError: no such field, or a difference of fields that are not alike.
    """
    columns: list[str] = []
    values: list[Array] = []
    for name in names:
        one, _, other = (part.strip() for part in name.partition(" - "))
        value = source[one]
        if other:
            if source[other].shape != value.shape:
                raise ShapeError(f"mode field '{name}': {value.shape[1]} columns minus {source[other].shape[1]}")
            value = value - source[other]
        label = name if not other else f"{_plain(one)} from {_plain(other)}{_unit(one)}"
        columns += [label] if value.shape[1] == 1 else [f"{label}[{index}]" for index in range(value.shape[1])]
        values.append(value)
    return tuple(columns), np.concatenate(values, axis=1)


def default_fields(source: Privileged | Observation) -> tuple[str, ...]:
    """The hand relative to everything that has a position, and every field of one column that is not a flag."""
    objects = [name for name in source.columns if name.endswith("_pos_m") and name not in _NOT_OBJECTS]
    single = [
        name
        for name, where in source.columns.items()
        if where.stop - where.start == 1 and name.endswith(("_m", "_rad")) and name not in objects
    ]
    return (*(f"{HAND} - {name}" for name in objects if HAND in source.columns), *single)


def _plain(field: str) -> str:
    return field.removesuffix("_m").removesuffix("_pos")


def _unit(field: str) -> str:
    return "_m" if field.endswith("_m") else "_rad" if field.endswith("_rad") else ""


def save_modes(path: Path | str, modes: ModeClassifier) -> None:
    """Write a `.npz`."""
    about = {name: getattr(modes, name) for name in ("world", "digest", "strategy", "fields", "columns")}
    names = ("centre", "spread", "weights", "means", "covariances", "sizes")
    arrays = {name: getattr(modes, name) for name in names} | {"about": np.array(json.dumps(about, sort_keys=True))}
    save_arrays(path, arrays, schema=SCHEMA, version=VERSION)


def load_modes(path: Path | str, world: World) -> ModeClassifier:
    """Read what `save_modes` wrote.

    Raises:
        ArtifactError: missing, damaged, of another version, or of another world.
    """
    arrays = load_arrays(path, schema=SCHEMA, version=VERSION)
    about: dict[str, Any] = json.loads(str(arrays.pop("about")))
    if (about["world"], about["digest"]) != (world.name, world.digest):
        raise ArtifactError(
            f"{path}: modes of world '{about['world']}' ({about['digest']}), not of '{world.name}' ({world.digest}); "
            "run `python -m stages.cluster` again"
        )
    about |= {"fields": tuple(about["fields"]), "columns": tuple(about["columns"])} | arrays
    return ModeClassifier(**about)
