"""A search for better plans that goes on whenever it is given effort: tabu search, and covering where that is better.

The two rules of tabu search take turns. Where the fewest facilities are the best, the search for covers has every turn,
one of three with a facility fewer.
"""

from __future__ import annotations

import numpy as np

from p2l.records import BoolArray
from p2l.team.facility.alarm import Flag
from p2l.team.facility.covering import cover, is_covering
from p2l.team.facility.local_search import columns_of
from p2l.team.facility.pairs import Pairs
from p2l.team.facility.tabu import Trail, wander

_SOONER = 0.5  # of the effort is enough where the search is for covers


class Walk:
    """Goes on whenever it is given effort; its rules take turns.

    Args:
        pairs: the instance.
        open_set: [F] where it begins.
        upper: its cost.
        rng: of ties, of tenures and of facilities closed at random.
    """

    def __init__(self, pairs: Pairs, open_set: BoolArray, upper: float, rng: np.random.Generator) -> None:
        self._pairs, self._columns, self._rng = pairs, columns_of(pairs), rng
        self._trail, self._turns = Trail(open_set, upper, open_set), 0
        self._covers = is_covering(pairs)

    @property
    def cost(self) -> float:
        """Of its best plan."""
        return self._trail.cost

    def further(self, effort: float, flag: Flag) -> Trail:
        """Where the search stands after some more steps of work, fewer if the `flag` is raised."""
        trail, rng = self._trail, self._rng
        if self._covers:
            count = int(trail.best.sum()) - (1 if self._turns % 3 == 0 else 0)
            self._trail = cover(self._pairs, self._columns, trail, count, _SOONER * effort, rng, flag)
        else:
            steepest = self._turns % 2 == 0
            self._trail = wander(self._pairs, self._columns, trail, effort, rng, steepest=steepest, flag=flag)
        self._turns += 1
        return self._trail

    def patiently(self, patience: float, flag: Flag) -> Trail:
        """Where it stands when it has found nothing better for `patience` steps."""
        idle, turns = 0, 8
        while idle < turns and flag[0] == 0:
            before = self._trail.cost
            idle = 0 if self.further(patience / turns, flag).cost < before else idle + 1
        return self._trail

    def goes_on_from(self, open_set: BoolArray, upper: float) -> None:
        """A better plan was found elsewhere: open set [F] and cost."""
        self._trail = Trail(open_set, upper, open_set)
