"""Draw docs/layers.png: the rooms of `src/p2l` in their layers, with the imports between them, read from the code.

    python scripts/draw_layers.py

Layers are those that import-linter holds (pyproject.toml). An arrow leads from a room to one that it imports; those
that follow from others (a imports b, b imports c) are left out, and so are those to single modules, which all may use.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import networkx as nx
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from p2l.closure import imports
from p2l.evaluation.style import png

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "layers.png"
WIDTH, HEIGHT, STEP, GAP = 1.5, 0.5, 1.0, 0.25
COLOURS = ("#DCE9F5", "#F7E6D4")


def layers() -> list[list[str]]:
    """Rooms by layer, the highest first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    [held] = [contract["layers"] for contract in contracts if contract["type"] == "layers"]
    return [[name.strip().removeprefix("p2l.") for name in layer.split("|")] for layer in held]


def arrows(rooms: set[str]) -> nx.DiGraph:
    """Which room imports which, without what follows from other arrows."""
    graph = nx.DiGraph()
    graph.add_nodes_from(sorted(rooms))
    for top in ("src/p2l", "stages"):
        for file in sorted((ROOT / top).rglob("*.py")):
            parts = file.relative_to(ROOT / "src").with_suffix("").parts if top != "stages" else ("stages",)
            room = parts[1] if len(parts) > 1 else "stages"
            for module, names in imports(file, "p2l"):
                path = module.split(".")
                targets = [path[1]] if path[0] == "p2l" and len(path) > 1 else list(names) if module == "p2l" else []
                graph.add_edges_from((room, target) for target in targets if {room, target} <= rooms and room != target)
    return nx.transitive_reduction(graph)


def draw() -> bytes:
    """The picture as PNG."""
    held = layers()
    place = {}
    for level, rooms in enumerate(held):
        across = len(rooms) * WIDTH + (len(rooms) - 1) * GAP
        for rank, room in enumerate(rooms):
            place[room] = (rank * (WIDTH + GAP) - across / 2, -level * STEP)
    figure = Figure(figsize=(8.5, 0.62 * len(held)), layout="constrained")
    axes = figure.subplots()
    rooms = {room for room in place if room == "stages" or (ROOT / "src" / "p2l" / room).is_dir()}
    for importer, imported in sorted(arrows(rooms).edges):
        (left, top), (other, below) = place[importer], place[imported]
        axes.annotate(
            "", (other + WIDTH / 2, below + HEIGHT), (left + WIDTH / 2, top),
            arrowprops={"arrowstyle": "-|>", "color": "#7788AA", "lw": 0.9, "shrinkA": 0, "shrinkB": 0}, zorder=1,
        )  # fmt: skip
    for level, rooms in enumerate(held):
        for room in rooms:
            left, low = place[room]
            box = FancyBboxPatch(
                (left, low),
                WIDTH,
                HEIGHT,
                boxstyle="round,pad=0.02",
                fc=COLOURS[level % 2],
                ec="#445566",
                lw=0.9,
                zorder=2,
            )
            axes.add_patch(box)
            axes.text(left + WIDTH / 2, low + HEIGHT / 2, room, ha="center", va="center", fontsize=9, zorder=3)
    axes.set(xlim=(-4.0, 4.0), ylim=(-len(held) * STEP + 0.7, 0.8))
    axes.axis("off")
    return png(figure)


if __name__ == "__main__":
    PICTURE.write_bytes(draw())
