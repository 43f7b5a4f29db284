"""The preconditions of a chain of nominal skills, as one record: vertices ρ_1 … ρ_K and the goal of the skill graph.

Axis letters: N states, D state columns, K skills, M = K + 1 targets (a precondition each, the goal last).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from p2l.artifacts import load_arrays, part, save_arrays
from p2l.contracts.world import World
from p2l.errors import ArtifactError, ShapeError
from p2l.preconditions.classifier import PreconditionClassifier
from p2l.preconditions.mixture import Mixture
from p2l.records import Array, BoolArray, freeze

SCHEMA, VERSION = "preconditions", 1
GOAL = "goal"


@dataclass(frozen=True)
class Preconditions:
    """What Algorithm 2 returns.

    Attributes:
        world: registered name.
        digest: of the world in which skills were executed.
        names: K names of skills.
        skills: K classifiers, in order.
        goal: density of the states in which nominal executions end.
        nominal: [K] how often each skill reaches the next precondition from where its own holds, on held-out samples.
        threshold: probability from which a precondition holds.
    """

    world: str
    digest: str
    names: tuple[str, ...]
    skills: tuple[PreconditionClassifier, ...]
    goal: Mixture
    nominal: Array
    threshold: float = 0.5

    def __post_init__(self) -> None:
        count = len(self.names)
        if len(self.skills) != count or not count:
            raise ShapeError(f"preconditions: {len(self.skills)} classifiers of {count} skills; expected one each")
        nominal = freeze("nominal", self.nominal, (count,), {}, low=0.0, high=1.0)
        object.__setattr__(self, "nominal", nominal)
        if not 0.0 < self.threshold < 1.0:
            raise ShapeError(f"preconditions: threshold {self.threshold}; expected a value between 0 and 1")

    @property
    def targets(self) -> tuple[str, ...]:
        """M names of where a recovery may lead."""
        return (*self.names, GOAL)

    def probability(self, states: Array, done: BoolArray) -> Array:
        """[N, M] ρ(s) of states [N, D]; that of the goal is 1 where the task is done [N], else 0."""
        columns = [skill.probability(states) for skill in self.skills]
        return np.stack([*columns, done.astype(np.float64)], axis=1)

    def holds(self, states: Array, done: BoolArray) -> BoolArray:
        """[N, M] which targets hold."""
        return np.asarray(self.probability(states, done) >= self.threshold)

    def density(self, target: int) -> Mixture:
        """D⁺ of a target."""
        return self.goal if target == len(self.skills) else self.skills[target].positive


def save_preconditions(path: Path | str, preconditions: Preconditions) -> None:
    """Write a `.npz`."""
    about = {name: getattr(preconditions, name) for name in ("world", "digest", "names", "threshold")}
    arrays = {
        f"{index}.{key}": value
        for index, skill in enumerate(preconditions.skills)
        for key, value in skill.arrays().items()
    }
    arrays |= preconditions.goal.arrays("goal.") | {"nominal": preconditions.nominal}
    arrays["about"] = np.array(json.dumps(about, sort_keys=True))
    save_arrays(path, arrays, schema=SCHEMA, version=VERSION)


def load_preconditions(path: Path | str, world: World) -> Preconditions:
    """Read what `save_preconditions` wrote.

    Raises:
        ArtifactError: missing, damaged, of another version, or of another world.
    """
    arrays = load_arrays(path, schema=SCHEMA, version=VERSION)
    about = json.loads(str(arrays["about"]))
    if (about["world"], about["digest"]) != (world.name, world.digest):
        raise ArtifactError(
            f"{path}: preconditions of world '{about['world']}' ({about['digest']}), not of '{world.name}' "
            f"({world.digest}); run `python -m stages.fit_preconditions` again"
        )
    names = tuple(about["names"])
    skills = tuple(PreconditionClassifier.from_arrays(part(arrays, f"{k}.")) for k in range(len(names)))
    goal = Mixture.from_arrays(arrays, "goal.")
    return Preconditions(world.name, world.digest, names, skills, goal, arrays["nominal"], float(about["threshold"]))
