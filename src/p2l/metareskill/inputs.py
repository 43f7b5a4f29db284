"""What chapter 4's stages work on, read and checked: the world with its preconditions, failures and their modes."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from p2l.contracts.world import symbols_of
from p2l.failures.classifier import load_modes
from p2l.failures.record import Failures, check_pair, check_params, load_failures, open_world
from p2l.metareskill.query import QueryOptions
from p2l.metareskill.setting import Rewards, Setting, check_measurable, members, start_graph
from p2l.metareskill.start import recorded_start
from p2l.metareskill.target import RecoveryTask
from p2l.preconditions.record import load_preconditions

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Files:
    """Artifacts of the stages before.

    Attributes:
        failures: to train from.
        held_out: to measure on.
        modes: of failures.
        preconditions: of nominal skills.
    """

    failures: Path
    held_out: Path
    modes: Path
    preconditions: Path


@dataclass(frozen=True)
class Inputs:
    """Everything that all seeds and choosers share, and all recorded failures."""

    setting: Setting
    train: Failures
    held_out: Failures


def open_inputs(
    files: Files,
    world: str,
    params: Mapping[str, Any],
    rewards: Rewards,
    options: QueryOptions,
    trials: int,
    *,
    guesses: Sequence[str],
    records: Path,
    item: str,
) -> Inputs:
    """Read and check every input; nothing is computed before all of them fit together.

    Args:
        files: to be read.
        world: name or target.
        params: of the world.
        rewards: of the skill graph.
        options: of queries.
        trials: see `Setting`.
        guesses: motions that recoveries may begin with, see `start`; none: they succeed never before they are trained.
        records: folder in which the start of the recoveries is kept.
        item: name of its record.

    Raises:
        ArtifactError: missing, damaged, or not of one and the same world, discovery and clustering.
    """
    train, held_out = load_failures(files.failures, "train"), load_failures(files.held_out, "held_out")
    check_params(train, world, params, files.failures)
    check_pair(train, held_out, files.held_out)
    there, _ = open_world(train, files.failures)
    modes = load_modes(files.modes, there)
    task = RecoveryTask(there, symbols_of(there), load_preconditions(files.preconditions, there))
    failures, exclusions = members(task, train, modes)
    tests, test_exclusions = members(task, held_out, modes)
    if exclusions + test_exclusions:
        log.info(
            "left out, since a learnt precondition holds: %d and %d held-out failures", exclusions, test_exclusions
        )
    start_graph(task, failures, modes, rewards)  # refuses modes without failures before anything is run
    check_measurable(tests, len(modes))
    start = recorded_start(records, item, task, failures, tests, options, guesses, trials)
    graph = start_graph(task, failures, modes, rewards, start)
    return Inputs(Setting(task, modes, failures, tests, graph, options, trials, start), train, held_out)
