"""Erlenkotter's dual ascent: a feasible dual in a few passes, and the plan that its tight facilities suggest.

Raising v_i spends the slack f_j - Σ_i (v_i - c_ij)⁺ of every facility that i would use; a facility without slack is
worth opening. The dual is feasible, so Σ v_i is a lower bound. It is a few percent off at a thousand tasks: a start
for the volume algorithm, and an approximation that carries its own certificate.

Source: Erlenkotter, "A dual-based procedure for uncapacitated facility location" (1978).
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from p2l.records import Array, BoolArray
from p2l.team.facility.alarm import Flag, silent
from p2l.team.facility.kernel import kernel
from p2l.team.facility.pairs import Pairs


def dual_ascent(pairs: Pairs, multipliers: Array | None = None, flag: Flag | None = None) -> tuple[Array, BoolArray]:
    """Feasible multipliers [D], whose sum is a lower bound, and the open set [F] they suggest.

    Args:
        pairs: the instance.
        multipliers: [D] a feasible dual to raise; each demand's cheapest cost if none.
        flag: stops the ascent when it is raised.
    """
    if multipliers is None:
        v = pairs.outside.copy()
        some = np.diff(pairs.start) > 0
        v[some] = pairs.cost[pairs.start[:-1][some]]
    else:
        v = np.minimum(multipliers, pairs.outside)
    slack = _raise(pairs, v, silent() if flag is None else flag)
    return v, _suggest(pairs, v, slack)


@kernel
def _slacks(pairs, v, front):
    """The slack of every facility [F]; `front` [D] becomes the first pair of each row whose cost is above v_i."""
    slack = pairs.opening.copy()
    for i in range(v.size):
        z = pairs.start[i]
        while z < pairs.start[i + 1] and pairs.cost[z] <= v[i]:
            slack[pairs.facility[z]] -= v[i] - pairs.cost[z]
            z += 1
        front[i] = z
    return np.maximum(slack, 0.0)  # rounding only: v is feasible


@kernel
def _lift(pairs, i, v, slack, front):
    """Raise v_i to its next cost level or until a slack is used up; True when it may rise again."""
    row_end = pairs.start[i + 1]
    target = pairs.cost[front[i]] if front[i] < row_end else pairs.outside[i]
    room, tight = target - v[i], False
    for z in range(pairs.start[i], front[i]):
        if slack[pairs.facility[z]] <= room:
            room, tight = slack[pairs.facility[z]], True
    for z in range(pairs.start[i], front[i]):
        slack[pairs.facility[z]] -= room
    if tight:
        v[i] += room
        return False
    v[i] = target
    while front[i] < row_end and pairs.cost[front[i]] <= target:
        front[i] += 1
    return target < pairs.outside[i]


@kernel
def _raise(pairs, v, flag):
    front = np.empty(v.size, dtype=np.int64)
    slack = _slacks(pairs, v, front)
    active = np.arange(v.size)
    count = active.size
    while count > 0 and flag[0] == 0:
        rest = 0
        for k in range(count):
            if flag[0] != 0:
                break
            i = active[k]
            if _lift(pairs, i, v, slack, front):
                active[rest] = i
                rest += 1
        count = rest
    return slack


@kernel
def _suggest(pairs, v, slack):
    """Tight facilities that some demand needs: first those it has no other choice than, then its cheapest."""
    is_open = np.zeros(slack.size, dtype=np.bool_)
    for only_choice in (True, False):
        for i in range(v.size):
            cheapest, count, has_service = -1, 0, False
            for z in range(pairs.start[i], pairs.start[i + 1]):
                if pairs.cost[z] > v[i]:
                    break
                j = pairs.facility[z]
                if slack[j] <= 1e-9 * pairs.opening[j]:
                    count += 1
                    cheapest = j if cheapest < 0 else cheapest
                    has_service = has_service or is_open[j]
            if not has_service and cheapest >= 0 and (count == 1 or not only_choice):
                is_open[cheapest] = True
    return is_open
