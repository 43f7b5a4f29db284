"""What recovery training leaves: the graph with its learnt probabilities, and the skills behind them.

Axis letters: I modes, M targets.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from p2l.artifacts import AnyArray, config_hash, load_arrays, part, save_arrays
from p2l.contracts.world import World
from p2l.errors import ArtifactError
from p2l.failures.classifier import ModeClassifier
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.identity import modes_hash, preconditions_hash
from p2l.metareskill.regression import ParameterisedSkill
from p2l.metareskill.trainer import Trainer
from p2l.preconditions.record import Preconditions
from p2l.skills.relative import Timing

SCHEMA, VERSION = "recoveries", 4
Skills = Mapping[tuple[int, int], ParameterisedSkill]


@dataclass(frozen=True)
class Recoveries:
    """Learnt recoveries of one world, for one set of failure modes.

    Attributes:
        world: registered name.
        digest: of the world.
        modes: hash of the failure modes, see `modes_hash`.
        preconditions: hash of the preconditions.
        graph: success probabilities [I, M] among others.
        skills: by (mode, target), of those that solved a failure.
        timing: of their motions.
        origin: hash of the trainings that they come from, see `collect`; empty where their numbers are all that is
            known of them.
    """

    world: str
    digest: str
    modes: str
    preconditions: str
    graph: SkillGraph
    skills: Skills
    timing: Timing
    origin: str = ""


def recoveries_hash(recoveries: Recoveries) -> str:
    """Identifies recoveries by the trainings that they come from; else by their skills and success probabilities.

    A skill is fitted to features that are computed anew from stored states, so its last bits differ from one processor
    to another, and records of its episodes would be lost.
    """
    graph = {key: value.tolist() for key, value in recoveries.graph.arrays().items()}
    if recoveries.origin:
        rewards = [graph[name] for name in ("skill_reward", "recovery_reward", "c_fail")]
        return config_hash(
            [recoveries.preconditions, recoveries.modes, asdict(recoveries.timing), rewards, recoveries.origin]
        )
    skills = {
        f"{mode}.{target}.{key}": value.tolist()
        for (mode, target), skill in recoveries.skills.items()
        for key, value in skill.arrays().items()
    }
    return config_hash([recoveries.preconditions, recoveries.modes, asdict(recoveries.timing), graph, skills])


def collect(
    trainer: Trainer, modes: ModeClassifier, graph: SkillGraph, history: History, episodes: int = 1
) -> Recoveries:
    """The best skills of a training that is over, `episodes` trainings in each of its rounds.

    Their origin is the ledger, and how often each recovery was trained: all that they are a function of.
    """
    preconditions = trainer.task.preconditions
    skills = {
        (mode, target): trainer.skill(mode, target, int(count) * episodes)
        for (mode, target), count in np.ndenumerate(history.counts)
    }
    return Recoveries(
        world=preconditions.world,
        digest=preconditions.digest,
        modes=modes_hash(modes),
        preconditions=preconditions_hash(preconditions),
        graph=graph.with_q(history.best),
        skills={key: skill for key, skill in skills.items() if skill is not None},
        timing=trainer.options.timing,
        origin=config_hash([trainer.ledger.identity, episodes, history.counts.tolist()]),
    )


def save_recoveries(path: Path | str, recoveries: Recoveries) -> None:
    """Write a `.npz`."""
    about = {name: getattr(recoveries, name) for name in ("world", "digest", "modes", "preconditions", "origin")}
    about |= {"timing": asdict(recoveries.timing), "skills": [list(key) for key in recoveries.skills]}
    arrays: dict[str, AnyArray] = {"about": np.array(json.dumps(about, sort_keys=True))}
    arrays |= {f"graph.{key}": value for key, value in recoveries.graph.arrays().items()}
    for (mode, target), skill in recoveries.skills.items():
        arrays |= {f"skill.{mode}.{target}.{key}": value for key, value in skill.arrays().items()}
    save_arrays(path, arrays, schema=SCHEMA, version=VERSION)


def load_recoveries(path: Path | str, world: World, preconditions: Preconditions, modes: ModeClassifier) -> Recoveries:
    """Read what `save_recoveries` wrote.

    Raises:
        ArtifactError: missing, damaged, of another version, or of another world, other preconditions or other modes.
    """
    arrays = load_arrays(path, schema=SCHEMA, version=VERSION)
    about = json.loads(str(arrays["about"]))
    identity = {
        "world": world.name,
        "digest": world.digest,
        "preconditions": preconditions_hash(preconditions),
        "modes": modes_hash(modes),
    }
    if other := [name for name, value in identity.items() if about[name] != value]:
        raise ArtifactError(
            f"{path}: recoveries were learnt with another {', '.join(other)}; "
            "give the files that they were learnt with, or run `python -m stages.learn_recoveries` again"
        )
    keys = [(int(mode), int(target)) for mode, target in about["skills"]]
    skills = {
        (mode, target): ParameterisedSkill.from_arrays(part(arrays, f"skill.{mode}.{target}.")) for mode, target in keys
    }
    timing = Timing(**{name: tuple(value) for name, value in about["timing"].items()})
    graph = SkillGraph.from_arrays(part(arrays, "graph."))
    return Recoveries(**identity, graph=graph, skills=skills, timing=timing, origin=about["origin"])
