"""Look-ahead: train what is expected to raise the value of failures most per unit of cost, and stop where nothing pays.

For every recovery the expected rise of the value of failures after its next 1 … H queries is the mean over all
hypotheses of its learning curve (`curves`) and over how many of those queries are solved; the value of each is found by
value iteration on the graph. The best of the rises per cost decides, so that a recovery which needs three queries to
become worth anything is not passed over for one that gains a little at once. No initial rounds are needed: what was not
trained has the belief that the others give it.

This is ours, not the thesis's. In Algorithm 3 a recovery whose first two queries are unsolved has a spread of 0, its
upper limit equals its success rate, and it is never trained again; here two unsolved queries make it less likely to be
worth a third one, by as much as the recoveries beside it say.

Axis letters: G hypotheses, I modes, M targets, H queries ahead.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from p2l.errors import ConfigError
from p2l.metareskill.choosers.contract import Choice, Rule, best_of, check_number
from p2l.metareskill.choosers.curves import CurveBelief, Sharing, belief
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.value_iteration import predicted_value
from p2l.records import Array, freeze

NOTHING = 1e-9  # expected rises that differ by no more are alike


def lookahead(
    horizon: int = 5,
    c_learn: float = 0.0,
    costs: Sequence[Sequence[float]] | None = None,
    trust: float = 10.0,
    share_mode: float = 0.2,
    share_target: float = 0.2,
    share_rest: float = 0.05,
) -> Rule:
    """The highest expected rise of the value of failures per cost, within `horizon` queries of one recovery.

    Args:
        horizon: queries that are looked ahead, at least 1.
        c_learn: cost of a query, in the unit of the value of failures (equation 1.2); where no recovery's rise exceeds
            its cost, training stops. 0: it goes on as long as there is budget.
        costs: [I][M] cost of a query of each recovery, relative to `c_learn`; none: all alike.
        trust: most trials that a measured success rate counts as.
        share_mode: how much another recovery's curve tells about one of the same mode, see `curves.Sharing`.
        share_target: likewise about one to the same target.
        share_rest: likewise about any other.

    Raises:
        ConfigError: a setting out of range, or costs that are not above 0; of the rule, costs of another graph's shape.
        ShapeError: costs that are no table of finite numbers.
    """
    check_number("lookahead: horizon", horizon, low=1, high=50, whole=True)
    check_number("lookahead: c_learn", c_learn, low=0.0)
    check_number("lookahead: trust", trust, low=0.0, strict=True)
    for name, share in (("share_mode", share_mode), ("share_target", share_target), ("share_rest", share_rest)):
        check_number(f"lookahead: {name}", share, low=0.0)
    sharing = Sharing(mode=share_mode, target=share_target, rest=share_rest)
    given = None if costs is None else freeze("costs", np.asarray(costs, dtype=np.float64), ("I", "M"), {}, low=0.0)
    if given is not None and not (given > 0.0).all():
        raise ConfigError("lookahead: costs must be above 0")

    def rule(graph: SkillGraph, history: History, rng: np.random.Generator) -> Choice | None:
        price = np.ones_like(graph.q) if given is None else given
        if price.shape != graph.q.shape:
            raise ConfigError(f"lookahead: costs of {price.shape} recoveries given; the graph has {graph.q.shape}")
        rises = expected_rises(graph, belief(history, sharing, trust), horizon)
        queries = np.arange(1, horizon + 1)[:, None, None]
        if c_learn > 0.0 and (rises - c_learn * queries * price).max() <= 0.0:
            return None
        rate = (rises / (queries * price)).max(axis=0)
        return best_of(rate, history, rng, "highest expected rise per cost", tie=NOTHING)

    return rule


def expected_rises(graph: SkillGraph, beliefs: CurveBelief, horizon: int) -> Array:
    """[H, I, M] expected rise of the value of failures after 1 … H further queries of each recovery alone.

    Args:
        graph: its rates are replaced by those that are believed.
        beliefs: of the curves.
        horizon: H.
    """
    now = graph.with_q(np.clip(beliefs.mean, 0.0, 1.0))
    values = np.stack([predicted_value(now, beliefs.rates(more)) for more in range(horizon + 1)])  # [H + 1, G, I, M]
    rise = np.maximum(values - values[0], 0.0)
    out = np.empty((horizon, *graph.q.shape))
    for ahead in range(1, horizon + 1):
        chance = _binomial(ahead, beliefs.solved)  # [ahead + 1, G]
        out[ahead - 1] = np.einsum("sg,sgim,gim->im", chance, rise[: ahead + 1], beliefs.weight)
    return out


def _binomial(trials: int, p: Array) -> Array:
    """[trials + 1, G] chances of 0 … `trials` successes."""
    successes = np.arange(trials + 1)[:, None]
    ways = np.array([math.comb(trials, each) for each in range(trials + 1)], dtype=np.float64)[:, None]
    return np.asarray(ways * p**successes * (1.0 - p) ** (trials - successes))
