"""Failures with the modes that they belong to.

Axis letters: N failures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.contracts.rows import Rows
from p2l.records import IntArray


@dataclass(frozen=True)
class Members:
    """Failures with their modes.

    Attributes:
        rows: [N].
        mode: [N].
    """

    rows: Rows
    mode: IntArray

    def of(self, mode: int) -> IntArray:
        """Indices of one mode's failures."""
        return np.flatnonzero(self.mode == mode)
