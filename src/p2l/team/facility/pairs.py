"""Useful pairs: a facility location instance without the services that no solution pays for.

Every demand has an outside option; a facility matters to it only where it is cheaper than that. What is left is stored
by demand (compressed rows), each row sorted by cost, so that a bound reads only the front of a row. `of_table` takes a
plain instance, `p2l.team.facility.reduction.of_problem` a team problem.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from p2l.records import Array, BoolArray, IntArray
from p2l.team.problem import Certificate

_BLOCK = 4_000_000  # entries of the dense table that are looked at together


class Pairs(NamedTuple):
    """A facility location instance with an outside option, in compressed rows (a tuple, as numba's kernels want).

    Attributes:
        opening: [F] cost f_j of opening a facility.
        outside: [D] cost b_i of leaving a demand to the outside option.
        start: [D + 1] where each demand's row begins.
        facility: [Z] int32, facility of each pair.
        cost: [Z] service cost c_ij, ascending within a row, each below the row's outside cost.
    """

    opening: Array
    outside: Array
    start: IntArray
    facility: npt.NDArray[np.int32]
    cost: Array

    @property
    def demands(self) -> int:
        """D."""
        return len(self.outside)

    @property
    def facilities(self) -> int:
        """F."""
        return len(self.opening)

    def rows(self) -> IntArray:
        """[Z] demand of each pair."""
        return np.repeat(np.arange(self.demands), np.diff(self.start))


@dataclass(frozen=True)
class PairsSolution:
    """What a solver says of `Pairs`: best open set [F], its cost, whether it ended inside the gap, and its proof."""

    open: BoolArray
    cost: float
    complete: bool
    certificate: Certificate


def of_table(opening_cost: Array, service_cost: Array) -> Pairs:
    """The useful pairs of a plain instance: opening_cost [F], service_cost [D, F].

    No demand need pay more than b_i = min_j (c_ij + f_j), since that facility could be opened for it alone. So b_i
    serves as an outside option: it loses no optimum, and it costs nothing in the relaxation, whose multipliers obey
    v_i <= c_ij + f_j anyway. `open_for_outside` turns a demand left outside into the facility that was meant.
    """
    outside = (service_cost + opening_cost).min(axis=1)

    def block(low: int, high: int) -> tuple[Array, BoolArray]:
        cost = service_cost[low:high]
        return cost, cost < outside[low:high, None]

    return collect(np.array(opening_cost), outside, block)


def open_for_outside(opening_cost: Array, service_cost: Array, open_set: BoolArray) -> BoolArray:
    """[F] the open set in which every demand that opening its own cheapest facility would serve better has it."""
    complete = open_set.copy()
    for i in range(len(service_cost)):
        alone = service_cost[i] + opening_cost
        j = int(alone.argmin())
        if not complete.any() or service_cost[i, complete].min() > alone[j]:
            complete[j] = True
    return complete


def collect(
    opening: Array,
    outside: Array,
    block: Callable[[int, int], tuple[Array, BoolArray]],
    deadline: float = math.inf,
) -> Pairs:
    """Pairs from the dense table of service costs, block by block of its rows, so that it is never held whole.

    Args:
        opening: [F].
        outside: [D].
        block: service costs [high - low, F] of the demands from `low` to before `high`, and which of them are useful.
        deadline: of `time.perf_counter`.

    Raises:
        TimeoutError: the deadline came first.
    """
    demands, width = len(outside), max(1, len(opening))
    step = max(1, _BLOCK // width)
    counts, facility, cost = [np.zeros(1, dtype=np.int64)], [], []
    for low in range(0, demands, step):
        if time.perf_counter() > deadline:
            raise TimeoutError
        column, value, count = _sorted_rows(*block(low, min(demands, low + step)))
        facility.append(column.astype(np.int32))
        cost.append(value)
        counts.append(count)
    return Pairs(
        opening=opening,
        outside=outside,
        start=np.cumsum(np.concatenate(counts)),
        facility=np.concatenate(facility),
        cost=np.concatenate(cost),
    )


def _sorted_rows(table: Array, useful: BoolArray) -> tuple[IntArray, Array, IntArray]:
    """Columns, values and row counts of the useful entries, ascending by value within each row."""
    count = useful.sum(axis=1)
    if count.sum() < 0.25 * useful.size:  # sorting whole rows would mostly sort what is thrown away
        row, column = np.nonzero(useful)
        value = table[row, column]
        by_cost = np.lexsort((value, row))
        return column[by_cost], value[by_cost], count
    value = np.where(useful, table, np.inf)
    column = value.argsort(axis=1)
    front = np.arange(table.shape[1]) < count[:, None]
    return column[front], np.take_along_axis(value, column, axis=1)[front], count
