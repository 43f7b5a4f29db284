"""What learnt skills do: paths of the tip for insertion (compare figure 3.6), taps on parts for Lego."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from p2l.contracts.domain import InsertionView, TapView, View
from p2l.evaluation.style import png

HIT, MISS, WALL, SLOT = "#0072B2", "#D55E00", "0.35", "#F0E442"
REACH_CM = 3.5


def strategy_figure(views: list[View], title: str) -> bytes:
    """One panel per skill; PNG bytes."""
    figure = Figure(figsize=(3.4 * len(views), 4.0), layout="constrained")
    for axes, view in zip(figure.subplots(1, len(views), squeeze=False)[0], views, strict=True):
        axes.set_aspect("equal")
        axes.set_title(view.name, fontsize=10)
        if isinstance(view, InsertionView):
            _paths(axes, view)
        else:
            _taps(axes, view)
    figure.suptitle(title, fontsize=11)
    return png(figure)


def _paths(axes: Axes, view: InsertionView) -> None:
    """Seen from above, cm, slot at the origin; a dot where each execution starts, a line for the path of the tip."""
    for x, y, half_x, half_y in 100.0 * view.walls:
        axes.add_patch(Rectangle((x - half_x, y - half_y), 2 * half_x, 2 * half_y, color=WALL, lw=0))
    half = 100.0 * view.slot_half_width
    axes.add_patch(Rectangle((-half, -half), 2 * half, 2 * half, facecolor=SLOT, edgecolor="k", lw=0.6))
    for path, success in zip(100.0 * view.paths, view.success, strict=True):
        colour = HIT if success else MISS
        axes.plot(path[:, 0], path[:, 1], color=colour, lw=0.7, alpha=0.8)
        axes.plot(*path[0, :2], "o", color=colour, ms=3)
    axes.set_xlim(-REACH_CM, REACH_CM)
    axes.set_ylim(-REACH_CM, REACH_CM)
    axes.set_xlabel(f"x, cm; {int(view.success.sum())} of {len(view.success)} inserted")
    axes.set_ylabel("y, cm")


def _taps(axes: Axes, view: TapView) -> None:
    """The part's cells seen from above, cm, and the area that each tap firms up."""
    side = view.cell_cm
    for x, y in view.cells:
        axes.add_patch(Rectangle((x - side / 2, y - side / 2), side, side, color="0.75", lw=0))
    for x, y in view.taps:
        axes.add_patch(Circle((x, y), view.radius_cm, color=HIT, alpha=0.15, lw=0))
        axes.plot(x, y, "x", color=HIT, ms=6)
    axes.autoscale_view()
    axes.set_xlabel(f"x, cm; {len(view.taps)} taps")
    axes.set_ylabel("y, cm")
