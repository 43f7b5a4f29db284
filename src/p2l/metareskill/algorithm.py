"""The loop of Algorithm 3: choose a recovery, train it, measure it, write the round down."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator

import numpy as np

from p2l.errors import ConfigError
from p2l.metareskill.choosers.contract import Choice, Chooser
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History, Round, Trained
from p2l.metareskill.value_iteration import value_of_failures

Train = Callable[[int, int, int], Trained]
"""Trains recovery (mode, target) once more; the third number counts its trainings so far.

A trainer that draws all its randomness from these three numbers and a seed (`seeding.generator`) makes training
resumable, and gives every chooser the same learning curves.
"""


def learn(
    graph: SkillGraph,
    chooser: Chooser,
    train: Train,
    *,
    rounds: int,
    rng: np.random.Generator,
    history: History | None = None,
    episodes: int = 1,
) -> Iterator[History]:
    """Train recoveries for `rounds` rounds, or until the chooser finds none worth its cost.

    Yields the history after each round, for the caller to save.

    Args:
        graph: the graph before any training.
        chooser: decides what to train.
        train: trains and measures.
        rounds: B of Algorithm 3.
        rng: the chooser's generator (PCG64); its state is part of the history.
        history: an earlier part of the same loop, which is then continued to the bit.
        episodes: η of Algorithm 3, trainings per round.

    Raises:
        ConfigError: fewer rounds than the chooser's initial ones, no training per round, a generator whose state
            cannot be kept, or a history of another graph. Raised at the call, before any training.

    Example:
        >>> import numpy as np
        >>> from p2l import SkillGraph, Trained, learn, make_chooser
        >>> graph = SkillGraph(nominal=np.array([0.9]), sizes=np.array([3.0]), q=np.zeros((1, 2)))
        >>> def train(mode, target, trainings):
        ...     return Trained(q=(0.9 if target == 1 else 0.4) * (1.0 - 0.5 ** (trainings + 1)))
        >>> rounds = learn(graph, make_chooser("round_robin"), train, rounds=4, rng=np.random.default_rng(0))
        >>> [(history.rounds[-1].target, round(history.rounds[-1].value, 2)) for history in rounds]
        [(0, -9.4), (1, -6.5), (0, -6.5), (1, -4.25)]
    """
    if not isinstance(rng.bit_generator, np.random.PCG64):
        raise ConfigError(f"learn: the generator must be a PCG64, got {type(rng.bit_generator).__name__}")
    check_budget(graph, chooser, rounds, episodes)
    past = History(graph.q) if history is None else history
    if not np.array_equal(past.initial, graph.q):
        raise ConfigError("learn: the history begins with other recoveries than the graph; delete it and start anew")
    return _rounds(graph, chooser, train, rounds, rng, past, episodes)


def check_budget(graph: SkillGraph, chooser: Chooser, rounds: int, episodes: int = 1) -> None:
    """Refuse a budget that does not cover the chooser's initial rounds; whoever compares choosers asks for all first.

    Raises:
        ConfigError: fewer rounds than the chooser's initial ones, or no training per round.
    """
    minimum = chooser.initial_rounds * graph.q.size
    if rounds < max(minimum, 1) or episodes < 1:
        raise ConfigError(
            f"learn: {rounds} rounds of {episodes} trainings given; chooser '{chooser.name}' needs at least "
            f"{max(minimum, 1)} rounds ({chooser.initial_rounds} initial ones for each of {graph.q.size} recoveries)"
        )


def _rounds(
    graph: SkillGraph,
    chooser: Chooser,
    train: Train,
    rounds: int,
    rng: np.random.Generator,
    history: History,
    episodes: int,
) -> Iterator[History]:
    if history.generator:
        rng.bit_generator.state = json.loads(history.generator)
    while len(history) < rounds:
        choice = chooser(graph.with_q(history.best), history, rng)
        if choice is None:
            return
        before = int(history.counts[choice.mode, choice.target]) * episodes
        results = [train(choice.mode, choice.target, before + episode) for episode in range(episodes)]
        result = max(results, key=lambda one: one.q)  # the better policy is kept; of equals the first
        latest = _explain(graph, history, choice, result)
        state = json.dumps(rng.bit_generator.state)
        history = dataclasses.replace(history, rounds=(*history.rounds, latest), generator=state)
        yield history


def _explain(graph: SkillGraph, history: History, choice: Choice, result: Trained) -> Round:
    pair = choice.mode, choice.target
    best = history.best.copy()
    before = float(best[pair])
    best[pair] = max(before, result.q)
    return Round(
        mode=choice.mode,
        target=choice.target,
        reason=choice.reason,
        q_before=before,
        q_upper=choice.q_upper,
        predicted=choice.predicted,
        q=result.q,
        trials=result.trials,
        solved=result.solved,
        value=float(value_of_failures(graph, best)),
    )
