"""Marks of the figure of a plan: arcs from lessons to what they serve, and hatched bars for expected failures."""

from __future__ import annotations

from typing import Any

import numpy as np

from p2l.evaluation.team.look import COLOURS
from p2l.records import Array
from p2l.team.problem import Decision

ARC_COLOURS = ("#882255", "#117733", "#332288", "#AA7700", "#007777", "#AA4499")  # one per lesson, in turn
NAME_LIMIT = 60  # up to so many tasks each has its name and a marker of its own


def arc(start: float, end: float, longest: float) -> Array:
    """[40, 2] a half circle from one place to another; the highest is that of the longest, with height 1."""
    angle = np.linspace(0.0, np.pi, 40)
    middle, radius = 0.5 * (start + end), 0.5 * (end - start)
    height = abs(end - start) / longest
    return np.stack([middle - radius * np.cos(angle), np.sqrt(height) * np.sin(angle)], axis=1)


def failure_style(with_names: bool) -> dict[str, Any]:
    """How the expected cost of failures is drawn: hatched where bars are wide enough."""
    if not with_names:
        return {"color": "#A9C4DD"}
    return {"facecolor": "white", "edgecolor": COLOURS[Decision.ACT], "hatch": "////", "linewidth": 0.6}
