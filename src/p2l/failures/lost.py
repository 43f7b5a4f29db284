"""Failures in the sense of chapter 4: states where no precondition holds, as learnt (thesis, section 4.3.1).

Discovery finds failures by the preconditions that a world's author wrote by hand; recoveries start where no learnt one
holds, since elsewhere a nominal skill goes on.
"""

from __future__ import annotations

import numpy as np

from p2l.contracts.symbols import Symbols
from p2l.contracts.world import World
from p2l.errors import ArtifactError
from p2l.failures.record import Failures
from p2l.preconditions.record import Preconditions
from p2l.records import IntArray


def lost(world: World, symbols: Symbols, preconditions: Preconditions, failures: Failures) -> IntArray:
    """[L] index of the failures where no learnt precondition holds, on the truth.

    Raises:
        ArtifactError: there is none.
    """
    states = symbols.state(world.privileged(failures.rows))
    index = np.flatnonzero(~preconditions.holds(states, world.goal(failures.rows)).any(axis=1))
    if not len(index):
        raise ArtifactError(
            f"no failure ({failures.origin.split}): in each of {len(failures)} states a learnt precondition holds; "
            "discover with more executions, or fit the preconditions with more samples"
        )
    return index
