"""The figure of a plan of a shop: what is done in order of work, by whom, at which cost, and what each lesson serves.

Places are the numbers of the rows of `plan_rows`, from 1. It is laid out by hand and drawn once by Agg: matplotlib's
own layout draws several times over, and pyplot costs more to import than all of the drawing.
"""

from __future__ import annotations

import unicodedata
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from p2l.artifacts import atomic
from p2l.evaluation.fonts import Fonts, fonts_for
from p2l.evaluation.team.look import COLOURS, MEANING, ORDER, UNIT, amount, limits
from p2l.evaluation.team.marks import ARC_COLOURS, NAME_LIMIT, arc, failure_style
from p2l.records import Array
from p2l.team.plan_files import proof_text
from p2l.team.problem import Decision
from p2l.team.shop.record import Shop, ShopPlan
from p2l.team.shop.rows import PlanRow, plan_rows
from p2l.text import drawable

_DPI = 150
_LONGEST = 18  # columns of a name, of which a Chinese letter takes two
_ROBOTS = 40  # robots with a line of their own; of more, those without work have none
_MANY = 150  # arcs; more are thin
_ARCS, _COSTS = 2.5, 1.75  # inches of these panels
_LEFT_TO_RIGHT = "\u200e"  # keeps "×3" behind a name that is written from the right


def save_shop_figure(path: Path | str, shop: Shop, plan: ShopPlan) -> None:
    """Draw a plan to a PNG (or what the suffix says), atomically.

    Raises:
        ArtifactError: the file cannot be written.
    """
    figure = shop_figure(shop, plan)
    with atomic(path) as temporary:
        if temporary.suffix.lower() == ".png":
            FigureCanvasAgg(figure).print_png(str(temporary), metadata={"Software": None})
        else:
            figure.savefig(temporary)


def shop_figure(shop: Shop, plan: ShopPlan) -> Figure:
    """The figure: arcs from each lesson to the attempts that it serves, who does what, and the expected cost.

    A name that no installed font can draw is replaced by the number of its row, with one warning.
    """
    rows = plan_rows(shop, plan)
    names = _Names.of(shop, rows)
    many = len(rows) > NAME_LIMIT
    robots = _robots(shop, rows)
    figure, panels = _panels(len(rows), bool(robots))
    above, who, below = panels
    served = _draw_arcs(above, rows, many)
    if who is not None:
        _draw_robots(who, rows, robots, names, many)
    _draw_costs(below, rows, many)
    below.set_xlim(0.3, len(rows) + 0.7)
    _label_rows(below, rows, names, many)
    apart = sum(row.task < 0 for row in rows)
    for axes in panels if apart else ():
        if axes is not None:
            axes.axvline(apart + 0.5, color="#888888", linewidth=0.8, linestyle=":")
    below.set_xlabel(
        f"task, {ORDER[shop.order]}" + ("; left of the dots: lessons on no task of today" if apart else "")
    )
    title = _title(shop, plan, rows)
    heading = figure.text(0.5, 1.0, title, fontsize=10, ha="center", va="top", parse_math=False)
    legend: list[Patch | Line2D] = [Patch(color=COLOURS[kind], label=MEANING[kind]) for kind in Decision]
    legend.append(Patch(**failure_style(not many), label="expected failure"))
    if served:
        legend.append(Line2D([], [], color=ARC_COLOURS[0], label="lesson pays for"))
    else:
        above.text(0.5, 0.5, "no lesson serves another task", transform=above.transAxes, ha="center", color="#666666")
        above.set_ylim(-0.6, 1.4)
    figure.legend(handles=legend, loc="lower center", ncols=len(legend), fontsize=8, frameon=False, borderaxespad=0.2)
    heights = (_COSTS, 0.1 + 0.18 * (len(robots) + 1) if robots else 0.0, _ARCS if served else 0.25 * _ARCS)
    head = 0.17 * (title.count("\n") + 1) + 0.1
    height = _lay_out(figure, panels, heights, head)
    heading.set_y(1.0 - 0.05 / height)
    return figure


@dataclass(frozen=True)
class _Names:
    """Names as they are drawn."""

    shop: Shop
    fonts: Fonts

    @classmethod
    def of(cls, shop: Shop, rows: Sequence[PlanRow]) -> _Names:
        """Choose fonts for all names that the figure has; warns once of those that have none."""
        if len(rows) > NAME_LIMIT and len(shop.robots) == 1:
            return cls(shop, fonts_for(()))
        used = [shop.tasks[row.task] if row.task >= 0 else shop.lessons[row.lesson] for row in rows]
        used = [] if len(rows) > NAME_LIMIT else used
        texts = [drawable(name) for name in dict.fromkeys([*used, *(shop.robots if len(shop.robots) > 1 else ())])]
        fonts = fonts_for(texts)
        if undrawn := [text for text in texts if not fonts.can_draw(text)]:
            count = f"{len(undrawn)} names have" if len(undrawn) > 1 else f"the name '{undrawn[0]}' has"
            warnings.warn(
                f"{count} letters that no installed font can draw; the figure shows numbers of rows instead. "
                "A font such as Noto Sans CJK, Noto Sans Devanagari or Noto Emoji helps once it is installed",
                stacklevel=4,
            )
        return cls(shop, fonts)

    def row(self, row: PlanRow, place: int) -> str:
        """Label of a row, `#7` if its name cannot be drawn."""
        name = self.shop.tasks[row.task] if row.task >= 0 else self.shop.lessons[row.lesson]
        text = self._drawn(name, f"#{place}")
        if row.copies <= 1:
            return text
        mark = _LEFT_TO_RIGHT if any(unicodedata.bidirectional(each) in ("R", "AL") for each in text) else ""
        return f"{mark}{text}{mark} ×{row.copies:,}"

    def robot(self, robot: int) -> str:
        """Name of a robot, or its number."""
        return self._drawn(self.shop.robots[robot], f"robot {robot + 1}")

    def _drawn(self, name: str, instead: str) -> str:
        text = drawable(name)
        return _short(text) if self.fonts.can_draw(text) else instead


def _robots(shop: Shop, rows: Sequence[PlanRow]) -> list[int]:
    """Robots that have a line of their own; none if there is only one robot."""
    if len(shop.robots) <= 1:
        return []
    if len(shop.robots) <= _ROBOTS:
        return list(range(len(shop.robots)))
    return sorted({robot for row in rows for robot in row.robots})


def _panels(places: int, robots: bool) -> tuple[Figure, tuple[Axes, Axes | None, Axes]]:
    figure = Figure(figsize=(float(np.clip(3.0 + 0.26 * places, 7.0, 18.0)), 5.4), dpi=_DPI)
    FigureCanvasAgg(figure)
    above = figure.add_axes((0.1, 0.5, 0.8, 0.4))
    who = figure.add_axes((0.1, 0.4, 0.8, 0.1), sharex=above) if robots else None
    return figure, (above, who, figure.add_axes((0.1, 0.1, 0.8, 0.3), sharex=above))


def _draw_arcs(axes: Axes, rows: Sequence[PlanRow], many: bool) -> int:
    """Half circles squeezed to one height scale; returns how many there are."""
    given = [place for place, row in enumerate(rows) if row.decision == Decision.LEARN]
    colour = {place: ARC_COLOURS[rank % len(ARC_COLOURS)] for rank, place in enumerate(given)}
    ends = [(row.source + 1.0, place + 1.0) for place, row in enumerate(rows) if row.source >= 0]
    shades = [colour[row.source] for row in rows if row.source >= 0]
    longest = max((end - start for start, end in ends), default=1.0)
    lines = [arc(start, end, longest) for start, end in ends]
    thin = len(ends) > _MANY
    width, alpha = (0.4, 0.35) if thin else (1.2, 0.8)
    axes.add_collection(
        LineCollection(lines, colors=shades, linewidths=width, alpha=alpha, zorder=1, label="lesson pays for")
    )
    place = np.arange(1.0, len(rows) + 1.0)
    if many:
        _draw_boxes(axes, place, np.full(len(rows), -0.06), np.zeros(len(rows)), 1.0, _colours(rows), zorder=3)
    else:
        axes.scatter([end for _, end in ends], np.full(len(ends), 0.035), marker="v", s=14, c=shades, zorder=4)
        axes.scatter(place[given], np.zeros(len(given)), marker="s", s=130, c=list(colour.values()), zorder=2)
        axes.scatter(place, np.zeros(len(rows)), marker="s", s=70, c=_colours(rows), zorder=3)
    axes.set_ylim(-0.08, 1.08)
    axes.set_yticks([])
    axes.spines[["left", "right", "top", "bottom"]].set_visible(False)
    axes.tick_params(bottom=False, labelbottom=False)
    return len(ends)


def _draw_robots(axes: Axes, rows: Sequence[PlanRow], robots: Sequence[int], names: _Names, many: bool) -> None:
    """A line for each robot and the person, on which their work is marked."""
    line = {robot: number + 1 for number, robot in enumerate(robots)}
    marks = [
        (place, line[robot] if robot >= 0 else 0, COLOURS[row.decision])
        for place, row in enumerate(rows, start=1)
        for robot in row.robots or (-1,)
    ]
    place, height = (np.array([mark[column] for mark in marks], dtype=float) for column in (0, 1))
    half, width = (0.4, 1.0) if many else (0.32, 0.55)
    _draw_boxes(axes, place, height - half, height + half, width, [mark[2] for mark in marks])
    axes.set_ylim(len(robots) + 0.6, -0.6)
    size = 8 if len(robots) <= _ROBOTS else 6
    texts = ["person", *(names.robot(robot) for robot in robots)]
    axes.set_yticks(range(len(texts)), texts, fontsize=size, parse_math=False, fontfamily=list(names.fonts.families))
    axes.grid(axis="y", color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["left", "right", "top", "bottom"]].set_visible(False)
    axes.tick_params(left=False, bottom=False, labelbottom=False)


def _draw_costs(axes: Axes, rows: Sequence[PlanRow], many: bool) -> None:
    place = np.arange(1.0, len(rows) + 1.0)
    certain = np.array([row.certain_cost for row in rows])
    total = np.array([row.expected_cost for row in rows])
    width = 1.0 if many else 0.75
    _draw_boxes(axes, place, np.zeros(len(rows)), certain, width, _colours(rows))
    risky = total > certain
    style = failure_style(not many)
    _draw_boxes(axes, place[risky], certain[risky], total[risky], width, style.pop("color", "white"), **style)
    axes.set_ylim(0.0, 1.15 * float(total.max(initial=0.0)) or 1.0)
    axes.set_ylabel(f"expected cost\n({UNIT})", fontsize=9)
    axes.tick_params(axis="y", labelsize=8)
    axes.spines[["right", "top"]].set_visible(False)
    if len(rows) <= 12:
        for x, y in zip(place.tolist(), total.tolist(), strict=True):
            axes.text(x, y, f"{y:,.0f}" if y >= 10.0 or y == 0.0 else amount(y), ha="center", va="bottom", fontsize=8)


def _draw_boxes(axes: Axes, place: Array, low: Array, high: Array, width: float, colour: Any, **style: Any) -> None:
    """Bars as one collection: a thousand of matplotlib's own bars take a second."""
    left, right = place - 0.5 * width, place + 0.5 * width
    corners = np.stack([np.stack([left, low], 1), np.stack([left, high], 1), np.stack([right, high], 1),
                        np.stack([right, low], 1)], axis=1)  # fmt: skip
    style.setdefault("facecolor", colour)
    axes.add_collection(PolyCollection(corners, **style))


def _label_rows(axes: Axes, rows: Sequence[PlanRow], names: _Names, many: bool) -> None:
    if many:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        return
    labels = [names.row(row, place) for place, row in enumerate(rows, start=1)]
    dense = len(rows) > 12 or max(map(_width, labels)) > 60 // len(rows)
    axes.set_xticks(
        np.arange(1, len(rows) + 1), labels, rotation=90 if dense else 0, fontsize=8, parse_math=False,
        fontfamily=list(names.fonts.families),
    )  # fmt: skip


def _title(shop: Shop, plan: ShopPlan, rows: Sequence[PlanRow]) -> str:
    act, person = (
        sum(row.copies for row in rows if row.decision == kind) for kind in (Decision.ACT, Decision.DELEGATE)
    )
    counts = f"{act:,} act, {person:,} delegate, {len(plan.taught):,} learn"
    proof = proof_text(plan.status, plan.objective, plan.lower_bound)
    first = f"Expected cost {amount(plan.objective)} ({proof}) – {counts}"
    return "\n".join([first, *(["Limits: " + ", ".join(limits(shop))] if limits(shop) else [])])


def _lay_out(
    figure: Figure, panels: tuple[Axes, Axes | None, Axes], heights: tuple[float, float, float], head: float
) -> float:
    """Put the panels, of `heights` in inches from below, where labels leave room; returns the figure's height.

    What labels take is measured once, and matplotlib keeps the measures for the drawing.
    """
    above, who, below = panels
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    renderer = canvas.get_renderer()
    boxes = [axis.get_tightbbox(renderer) for axis in ([below.yaxis] if who is None else [below.yaxis, who.yaxis])]
    side = max([below.bbox.x0 - box.x0 for box in boxes if box is not None], default=0.0) / _DPI + 0.1
    under = below.xaxis.get_tightbbox(renderer)
    foot = (below.bbox.y0 - under.y0 if under is not None else 0.0) / _DPI + 0.36
    gap = 0.07
    width, height = float(figure.get_figwidth()), foot + sum(heights) + 2 * gap + head
    figure.set_size_inches(width, height)
    low = foot
    for axes, size in zip((below, who, above), heights, strict=True):
        if axes is not None:
            axes.set_position((side / width, low / height, 1.0 - (side + 0.12) / width, size / height))
            low += size + gap
    return height


def _colours(rows: Sequence[PlanRow]) -> list[str]:
    return [COLOURS[row.decision] for row in rows]


def _width(text: str) -> int:
    """Columns that a text takes, two for each wide letter."""
    return sum(2 if unicodedata.east_asian_width(each) in "WF" else 1 for each in text)


def _short(name: str) -> str:
    if _width(name) <= _LONGEST:
        return name
    end = next(end for end in range(len(name), 0, -1) if _width(name[:end]) < _LONGEST)
    return name[:end] + "…"
