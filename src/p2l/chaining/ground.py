"""Where failures are practised and judged: a world, its nominal chain, and failures that were recorded there.

Axis letters: N failures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World


@dataclass(frozen=True)
class Ground:
    """A world with N of its failures.

    Attributes:
        world: where.
        nominal: the chain π_1 … π_k there.
        failures: N rows.
        name: among the worlds of a mixture; empty for the task's own.
    """

    world: World
    nominal: Sequence[Option]
    failures: Rows
    name: str = ""
