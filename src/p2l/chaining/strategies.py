"""The strategy of a recovery (thesis, sections 5.4.1 and 5.4.2).

The thesis names strategies without defining them; each world has its own definitions, see
`contracts.world.Strategic`.

Axis letters: N recoveries.
"""

from __future__ import annotations

from p2l.contracts.rows import Rows
from p2l.contracts.world import Strategic, World
from p2l.records import IntArray

AT_ONCE, OTHER, UNNAMED = "at_once", "other", "unnamed"


def strategy(world: World, before: Rows, after: Rows, primitives: IntArray) -> list[str]:
    """[N] strategies, by the change of the state between the failure and the last decision.

    Args:
        world: where.
        before: [N] the failures.
        after: [N] the moments of the last decisions.
        primitives: [N] number of primitives.

    Returns:
        names of the world's strategies, joined by `+`; `at_once` if control is handed back without any primitive,
        `other` for none of the world's strategies, `unnamed` in a world that has none.
    """
    tests = world.strategies(before, after) if isinstance(world, Strategic) else {}
    rest = OTHER if tests else UNNAMED
    names = []
    for row, count in enumerate(primitives.tolist()):
        true = [name for name, holds in tests.items() if holds[row]]
        names.append(AT_ONCE if not count else "+".join(true) or rest)
    return names
