"""Failures of both splits in modes: what is grouped, the modes, and the modes of held-out failures (thesis, 4.3.1)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from p2l.contracts.world import World, symbols_of
from p2l.failures.clustering import Clustering, ClusterOptions, cluster, typical
from p2l.failures.lost import lost
from p2l.failures.record import Failures
from p2l.preconditions.record import load_preconditions
from p2l.records import Array, IntArray

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Grouping:
    """Modes of training failures, and what they say of held-out ones.

    Attributes:
        train, held_out: the failures that were grouped.
        train_index, held_out_index: of these among all that were recorded.
        clustering: of the training failures.
        members: [K] the typical member of each mode, an index into `train`.
        held_out_mode: [H] by the classifier.
        held_out_probability: [H] of that mode.
    """

    train: Failures
    held_out: Failures
    train_index: IntArray
    held_out_index: IntArray
    clustering: Clustering
    members: IntArray
    held_out_mode: IntArray
    held_out_probability: Array

    def labels(self) -> dict[str, npt.NDArray[np.generic]]:
        """For `artifacts.save_arrays`."""
        return {
            "train": self.clustering.mode,
            "train_probability": self.clustering.probability,
            "train_index": self.train_index,
            "held_out": self.held_out_mode,
            "held_out_probability": self.held_out_probability,
            "held_out_index": self.held_out_index,
        }


def group_failures(
    world: World, train: Failures, held_out: Failures, options: ClusterOptions, seed: int, preconditions: Path | None
) -> Grouping:
    """Group the failures in which no learnt precondition holds; all of them without preconditions.

    Args:
        world: where they happened.
        train: to fit modes to.
        held_out: to be classified.
        options: how.
        seed: see `clustering.cluster`.
        preconditions: file of `fit_preconditions`, if there is one.

    Raises:
        ArtifactError: there is no failure, or preconditions of another world.
        ConfigError: fewer failures than modes, or a world without symbols.
    """
    train_index, held_out_index = (_index(world, failures, preconditions) for failures in (train, held_out))
    train, held_out = train.take(train_index), held_out.take(held_out_index)
    clustering = cluster(world, train, options, seed)
    members = typical(clustering, train)
    mode, probability = clustering.modes.classify(held_out.truth)
    return Grouping(train, held_out, train_index, held_out_index, clustering, members, mode, probability)


def _index(world: World, failures: Failures, preconditions: Path | None) -> IntArray:
    """Index of the failures to group."""
    if preconditions is None:
        return np.arange(len(failures))
    index = lost(world, symbols_of(world), load_preconditions(preconditions, world), failures)
    log.info("%s: in %d of %d failures no learnt precondition holds", failures.origin.split, len(index), len(failures))
    return index
