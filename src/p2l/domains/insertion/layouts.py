"""Where the slots and walls of the insertion tasks are: four environments, on and off a lattice, and the peg board.

*Grid* (thesis, section 3.5.1): four environments of 20 × 20 cm, each a 4 × 4 grid of 5 cm cells with another number
of wall segments on the grid's inner edges. A slot lies on a 3 × 3 lattice inside a cell, next to at least one wall.

*Continuous*: the same environments and cells, but a slot lies anywhere in the square that the lattice spans. On the
lattice most tasks of a day have the features of a task that was collected; here hardly any two are alike.

*Board* (thesis, table 3.1 and figure 3.5): 17 holes in the offset rows of a Chinese-checkers board, seen from above.
Holes 0–11 lie along the bottom wall, 12–16 along the right wall; neighbours alternate between the far row (even
numbers) and the near row (odd numbers). The predictor never sees the board: it is trained on `sample_board_tasks`,
single holes at random distances from one wall.
"""

from __future__ import annotations

import numpy as np

from p2l.contracts.domain import Tasks
from p2l.domains.insertion.features import (
    DIRECTIONS,
    FEATURE_NAMES,
    REACH,
    WALLS_PER_SCENE,
    task_features,
    wall_distances_cm,
)
from p2l.errors import ConfigError
from p2l.records import Array, IntArray

CELL = 0.05
CELLS = 4
WALL_HALF_THICKNESS = 0.005
# Distances from a slot's centre to the face of a wall on the cell's border: 1.1, 2.0 and 2.9 cm.
LATTICE = np.array([-0.009, 0.0, 0.009])
WALLS_OF_ENVIRONMENT = (6, 9, 12, 15)
NEAR_ROW, FAR_ROW = 0.009, 0.021
HOLE_PITCH = 0.016
BOTTOM_HOLES, RIGHT_HOLES = 12, 5
BOARD_WALL_HALF_LENGTH = 0.15
_PATIENCE = 10_000  # draws of a slot before there is said to be none


def grid_walls(rng: np.random.Generator, count: int) -> Array:
    """[count, 4] centre x, y and half sizes x, y (m) of wall segments on the inner edges of a 4 × 4 grid."""
    lines = (np.arange(1, CELLS) - CELLS / 2) * CELL
    middles = (np.arange(CELLS) + 0.5 - CELLS / 2) * CELL
    long, thin = CELL / 2 + WALL_HALF_THICKNESS, WALL_HALF_THICKNESS
    vertical = [(line, middle, thin, long) for line in lines for middle in middles]
    horizontal = [(middle, line, long, thin) for line in lines for middle in middles]
    edges = np.array(vertical + horizontal)
    if not 1 <= count <= len(edges):
        raise ConfigError(f"grid environment: {count} walls asked for; allowed are 1 to {len(edges)}")
    return np.asarray(edges[rng.permutation(len(edges))[:count]])


def grid_environments(layout_seed: int) -> tuple[Array, ...]:
    """The walls of the four environments; the same layout seed gives the same environments."""
    return tuple(
        grid_walls(np.random.default_rng([layout_seed, index]), count)
        for index, count in enumerate(WALLS_OF_ENVIRONMENT)
    )


def grid_slots(walls: Array, farthest_wall_cm: float) -> Array:
    """[L, 2] all lattice positions (m) of an environment with a wall face at most `farthest_wall_cm` away."""
    middles = (np.arange(CELLS) + 0.5 - CELLS / 2) * CELL
    axis = (middles[:, None] + LATTICE[None]).ravel()
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    near = [wall_distances_cm(relative_walls(walls, slot)).min() <= farthest_wall_cm for slot in grid]
    return np.asarray(grid[np.array(near)])


def relative_walls(walls: Array, slot: Array) -> Array:
    """Walls within reach of a slot, in the slot's frame [A, 4]."""
    relative = walls - np.array([slot[0], slot[1], 0.0, 0.0])
    gap = np.maximum(np.abs(relative[:, :2]) - relative[:, 2:], 0.0)
    return np.asarray(relative[np.linalg.norm(gap, axis=1) < REACH])


def make_tasks(names: list[str], groups: list[int], scenes: list[Array]) -> Tasks:
    """Tasks from the walls of each scene, in the slot's frame; zeros fill up to a common number of walls."""
    walls = np.zeros((len(scenes), WALLS_PER_SCENE, 4))
    counts = np.zeros(len(scenes), dtype=np.int64)
    for row, scene in enumerate(scenes):
        # The nearest faces first: where more walls are in reach than a scene holds, the farthest cannot matter.
        gap = np.linalg.norm(np.maximum(np.abs(scene[:, :2]) - scene[:, 2:], 0.0), axis=1)
        nearest = scene[np.argsort(gap, kind="stable")][:WALLS_PER_SCENE]
        walls[row, : len(nearest)], counts[row] = nearest, len(nearest)
    features = np.array([task_features(task[:count]) for task, count in zip(walls, counts, strict=True)])
    payload = {"walls": walls, "wall_count": counts}
    return Tasks(
        tuple(names), features.reshape(len(scenes), len(FEATURE_NAMES)), np.array(groups, dtype=np.int64), payload
    )


def sample_grid_tasks(rng: np.random.Generator, n: int, layout_seed: int, farthest_wall_cm: float) -> Tasks:
    """N slots drawn uniformly from the lattice positions of the four environments, environments equally likely."""
    environments = grid_environments(layout_seed)
    slots = [grid_slots(walls, farthest_wall_cm) for walls in environments]
    groups = rng.integers(len(environments), size=n)
    names, scenes = [], []
    for row, group in enumerate(groups):
        slot = slots[group][rng.integers(len(slots[group]))]
        names.append(f"env{group}-slot{row}")
        scenes.append(relative_walls(environments[group], slot))
    return make_tasks(names, groups.tolist(), scenes)


def sample_continuous_tasks(rng: np.random.Generator, n: int, layout_seed: int, farthest_wall_cm: float) -> Tasks:
    """N slots drawn uniformly from where cells' middles have a wall face at most `farthest_wall_cm` away.

    Environments are equally likely. What is near enough is found by drawing again, so some wall must be within reach.

    Raises:
        ConfigError: no slot of an environment was near enough in 10,000 draws.
    """
    environments = grid_environments(layout_seed)
    groups = rng.integers(len(environments), size=n)
    names, scenes = [], []
    for row, group in enumerate(groups):
        names.append(f"env{group}-slot{row}")
        scenes.append(_near_scene(rng, environments[group], farthest_wall_cm))
    return make_tasks(names, groups.tolist(), scenes)


def sample_board_tasks(rng: np.random.Generator, n: int, distance_m: tuple[float, float]) -> Tasks:
    """N single holes, each at a random distance from one long wall on a random side."""
    sides = rng.integers(len(DIRECTIONS), size=n)
    distances = rng.uniform(*distance_m, size=n)
    scenes = [_long_wall(side, distance)[None] for side, distance in zip(sides.tolist(), distances, strict=True)]
    return make_tasks([f"hole{row}" for row in range(n)], sides.tolist(), scenes)


def board_tasks(index: IntArray | None = None) -> Tasks:
    """The 17 holes of the board (or those of `index`), named by their number in figure 3.5."""
    walls, holes = board_layout()
    scenes = [relative_walls(walls, hole) for hole in holes]
    groups = [2 if number < BOTTOM_HOLES else 1 for number in range(len(holes))]
    tasks = make_tasks([str(number) for number in range(len(holes))], groups, scenes)
    return tasks if index is None else tasks.take(index)


def board_layout() -> tuple[Array, Array]:
    """Walls [2, 4] and hole centres [17, 2] of the board, m; bottom wall face at y = 0, right wall face at x = 0."""
    number = np.arange(BOTTOM_HOLES)
    row = np.where(number % 2 == 0, FAR_ROW, NEAR_ROW)
    bottom = np.stack([-0.06 - (BOTTOM_HOLES - 1 - number) * HOLE_PITCH, row], axis=1)
    number = np.arange(BOTTOM_HOLES, BOTTOM_HOLES + RIGHT_HOLES)
    row = np.where(number % 2 == 0, FAR_ROW, NEAR_ROW)
    right = np.stack([-row, 0.06 + (number - BOTTOM_HOLES) * HOLE_PITCH], axis=1)
    thin = WALL_HALF_THICKNESS
    walls = np.array([[-0.13, -thin, 0.13, thin], [thin, 0.09, thin, 0.09]])
    return walls, np.concatenate([bottom, right])


def _near_scene(rng: np.random.Generator, walls: Array, farthest_wall_cm: float) -> Array:
    """Walls in the frame of a slot that is drawn until one of them is near."""
    for _ in range(_PATIENCE):
        cell = rng.integers(CELLS, size=2)
        slot = (cell + 0.5 - CELLS / 2) * CELL + rng.uniform(LATTICE[0], LATTICE[-1], size=2)
        scene = relative_walls(walls, slot)
        if wall_distances_cm(scene).min() <= farthest_wall_cm:
            return scene
    raise ConfigError(f"insertion: no slot has a wall within farthest_wall_cm = {farthest_wall_cm}; give more")


def _long_wall(side: int, distance: float) -> Array:
    direction = DIRECTIONS[side]
    centre = direction * (distance + WALL_HALF_THICKNESS)
    half = np.where(direction != 0.0, WALL_HALF_THICKNESS, BOARD_WALL_HALF_LENGTH)
    return np.concatenate([centre, half])
