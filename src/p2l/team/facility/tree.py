"""The tree of cases that a search leaves behind as its proof (`p2l.team.certificate` reads it)."""

from __future__ import annotations

import numpy as np

from p2l.records import Array
from p2l.team.problem import Certificate

_MEMORY = 256_000_000  # bytes of multipliers; what comes after keeps those of its parent, and proves less


class Tree:
    """Nodes with their multipliers [D], in the indices of an instance with so many `facilities`."""

    def __init__(self, multipliers: Array, facilities: int = 0) -> None:
        self._rows, self._prices, self._facilities = [multipliers], [0.0], facilities
        self._nodes: list[tuple[int, int, int, bool]] = [(0, -1, -1, False)]  # row, parent, facility, is it open

    def price(self, node: int, multipliers: Array, count_price: float = 0.0) -> None:
        """The multipliers of a node are these, and this is what every opening counts less in them."""
        if len(self._rows) * multipliers.nbytes < _MEMORY:
            self._nodes[node] = (len(self._rows), *self._nodes[node][1:])
            self._rows.append(multipliers)
            self._prices.append(count_price)

    def child(self, parent: int, facility: int = -1, *, is_open: bool = False) -> int:
        """A case of `parent`, with its multipliers; one that decides nothing goes on with what they rule out."""
        self._nodes.append((self._nodes[parent][0], parent, facility, is_open))
        return len(self._nodes) - 1

    def count_case(self, parent: int, count: int, *, is_more: bool) -> int:
        """A case of `parent` in which more than `count` are open, or at most so many."""
        return self.child(parent, self._facilities + count, is_open=is_more)

    def certificate(self, target: float, scale: float) -> Certificate:
        """The proof that no solution costs less than `target`, costs divided by `scale`."""
        row, parent, facility, is_open = (np.array(part) for part in zip(*self._nodes, strict=True))
        used, row = np.unique(row, return_inverse=True)
        rows = np.stack([self._rows[each] for each in used.tolist()]) / scale
        prices = np.array(self._prices)[used] / scale
        count = prices if prices.any() else None
        return Certificate(rows, row, parent, facility, is_open.astype(bool), target / scale, count_prices=count)
