"""Lego stacking as coverage (thesis, section 3.5.2): which taps make a part of bricks sit firmly on its base plate?

A tap firms up everything within 3 cm. A skill is a set of taps in the grasp frame, in units of the part's bounding
box, so that it carries over to parts of similar shape and other sizes. It fails on a part when some of the part stays
loose, or when a tap misses the part and hits the base plate.

Deviations from the thesis:
    1. Learning draws many random tap sets of each length at once, instead of one growing sequence, and keeps the
       fewest taps that cover the image; among those, the set with the greatest clearance.
    2. An attempt is noisy (grasp slip and tap error), so that success is a probability as on the real robot.
    3. A part is firm when `covered` of its area is, in place of the thesis's count of locked corners.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import ClassVar

import numpy as np

from p2l.contracts.domain import Encoding, Progress, TapView, Tasks
from p2l.domains.lego.parts import PARTS, OverheadCamera, photograph, rotate
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray

PIXELS = 8  # side of the binarised image among the features
_PER_STUD = 4  # cells along a stud when a part's area is checked


@dataclass(frozen=True)
class Lego:
    """The Lego domain; lengths in cm.

    Attributes:
        firm_radius: how far a tap acts.
        tool_radius: a tap whose centre is farther than this from the part hits the base plate.
        covered: share of a part's area that must be firm.
        margin: clearance that learning asks for, so that a skill survives some noise.
        tap_noise: standard deviation of each tap's position.
        slip: standard deviation of the held part's position; its angle slips by slip_angle (radians).
        candidates: random tap sets tried for each number of taps.
        max_taps: the most taps a skill may have; P = 2 · max_taps.
        camera: the sensor.
    """

    firm_radius: float = 3.0
    tool_radius: float = 0.4
    covered: float = 0.98
    margin: float = 0.1
    tap_noise: float = 0.3
    slip: float = 0.1
    slip_angle: float = 0.03
    candidates: int = 20_000
    max_taps: int = 8
    camera: OverheadCamera = field(default_factory=OverheadCamera)

    name: ClassVar[str] = "lego"
    encoding: ClassVar[Encoding] = "concatenation"

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name != "camera" and not 0 <= value < np.inf:
                raise ConfigError(f"lego: {entry.name} is {value}; it must be a finite number of at least 0")
        if self.max_taps < 1 or self.candidates < 1 or not 0 < self.covered <= 1:
            raise ConfigError(
                f"lego: max_taps {self.max_taps} and candidates {self.candidates} must be at least 1, "
                f"and covered {self.covered} above 0 and at most 1"
            )
        if self.margin >= self.firm_radius:
            raise ConfigError(f"lego: margin {self.margin} must be less than firm_radius {self.firm_radius}")

    @property
    def feature_names(self) -> tuple[str, ...]:
        """The 8 × 8 image (column, row) and the size of the box."""
        pixels = (f"pixel_{x}_{y}" for x in range(PIXELS) for y in range(PIXELS))
        return (*pixels, "width_cm", "height_cm")

    def sample_tasks(self, rng: np.random.Generator, n: int) -> Tasks:
        """N pictures spread evenly over the fifteen parts (150 in the thesis, ten of each), a remainder at random."""
        rounds, rest = divmod(n, len(PARTS))
        parts = np.concatenate([np.tile(np.arange(len(PARTS)), rounds), rng.permutation(len(PARTS))[:rest]])
        return self._photograph(np.sort(parts), rng)

    def sample_set(self, rng: np.random.Generator, n: int) -> Tasks:
        """One planning problem: n different parts in random order, each with a fresh picture."""
        if n > len(PARTS):
            raise ConfigError(f"lego: a set of {n} different parts; there are {len(PARTS)}. Ask for fewer tasks.")
        return self._photograph(rng.permutation(len(PARTS))[:n], rng)

    def _photograph(self, parts: IntArray, rng: np.random.Generator) -> Tasks:
        m, s = len(parts), self.camera.samples
        image, size = np.zeros((m, s, s), dtype=bool), np.zeros((m, 2))
        offset, angle, copy = np.zeros((m, 2)), np.zeros(m), np.zeros(m, dtype=np.int64)
        for part in np.unique(parts):
            rows = np.flatnonzero(parts == part)
            views = photograph(PARTS[part], self.camera, rng, len(rows))
            image[rows], size[rows], offset[rows], angle[rows] = views.image, views.size, views.offset, views.angle
            copy[rows] = np.arange(len(rows))
        side = s // PIXELS
        small = image.reshape(m, PIXELS, side, PIXELS, side).mean(axis=(2, 4)) > 0.5
        return Tasks(
            names=tuple(f"{PARTS[part].name}/{i}" for part, i in zip(parts, copy, strict=True)),
            features=np.hstack([small.reshape(m, -1), size]),
            group=parts,
            payload={"image": image, "size": size, "offset": offset, "angle": angle},
        )

    def learn(self, tasks: Tasks, index: IntArray, rng: np.random.Generator, progress: Progress | None = None) -> Array:
        """Skills [K, 2 · max_taps]: tap positions (x, y) from the box's centre, in units of its width and height."""
        skills = np.full((len(index), 2 * self.max_taps), np.nan)
        for row, task in enumerate(index):
            taps = self._fewest_taps(tasks.payload["image"][task], tasks.payload["size"][task], rng)
            skills[row, : taps.size] = taps.ravel()
            if progress is not None:
                progress(row + 1, len(index))
        return skills

    def _fewest_taps(self, image: BoolArray, size: Array, rng: np.random.Generator) -> Array:
        """Taps [T, 2] in box units that cover the occupied cells of `image` [S, S] with at least `margin` to spare."""
        unit = (np.argwhere(image)[::4] + 0.5) / len(image) - 0.5
        places = unit * size
        distance = np.linalg.norm(places[:, None] - places[None], axis=-1)
        reach = np.packbits(distance <= self.firm_radius - self.margin, axis=1)  # [Q, Q / 8]
        everything = np.packbits(np.ones((1, len(places)), dtype=bool), axis=1)
        for count in range(1, self.max_taps + 1):
            tap_sets = rng.integers(len(places), size=(self.candidates, count))
            union = np.bitwise_or.reduce(reach[tap_sets], axis=1)
            full = np.flatnonzero((union == everything).all(axis=1))[:256]
            if full.size:
                break
        else:  # no set covers it: take the fullest of the longest
            full = np.unpackbits(union, axis=1).sum(axis=1).argmax(keepdims=True)
        loosest = distance[tap_sets[full]].min(axis=1).max(axis=1)
        return np.asarray(unit[tap_sets[full[loosest.argmin()]]])

    def evaluate(
        self,
        skills: Array,
        learnt_on: Tasks,  # noqa: ARG002 (box units carry all that a skill needs to know)
        tasks: Tasks,
        draws: int,
        rng: np.random.Generator,
        progress: Progress | None = None,  # noqa: ARG002 (done in seconds)
    ) -> BoolArray:
        """Success [K, M, R]; noise of draw r on task m is the same for every skill."""
        k, m, t = len(skills), len(tasks), skills.shape[1] // 2
        slip = rng.normal(0.0, self.slip, (m, draws, 1, 2))
        slip_angle = rng.normal(0.0, self.slip_angle, (m, draws, 1))
        noise = rng.normal(0.0, self.tap_noise, (m, draws, t, 2)) + slip
        unit = skills.reshape(k, 1, t, 2)
        success = np.zeros((k, m, draws), dtype=bool)
        for j in range(m):
            box = {name: tasks.payload[name][j] for name in ("size", "offset", "angle")}
            taps = rotate(unit * box["size"] + noise[j], box["angle"] + slip_angle[j]) + box["offset"]
            success[:, j] = self.firm(int(tasks.group[j]), taps)
        return success

    def view(self, skill: Array, task: Tasks, rng: np.random.Generator) -> TapView:  # noqa: ARG002 (nothing is drawn)
        """Taps on the part as the camera saw it."""
        image, size = task.payload["image"][0], task.payload["size"][0]
        unit = skill.reshape(-1, 2)
        cells = (np.argwhere(image) + 0.5) / len(image) - 0.5
        taps = unit[np.isfinite(unit[:, 0])] * size
        return TapView(task.names[0], cells * size, float(size.max() / len(image)), taps, self.firm_radius)

    def firm(self, part: int, taps: Array) -> BoolArray:
        """Whether taps [..., T, 2] (part frame, cm; NaN rows are absent) lock part number `part`: [...]."""
        present = np.isfinite(taps[..., 0])
        positions = np.where(present[..., None], taps, 1e6)
        misses = (present & (PARTS[part].distance(positions) > self.tool_radius)).any(axis=-1)
        result = np.zeros(taps.shape[:-2], dtype=bool)
        result[~misses] = self.coverage(part, positions[~misses]) >= self.covered
        return result

    def coverage(self, part: int, taps: Array) -> Array:
        """Share [N] of a part's area within `firm_radius` of taps [N, T, 2] (part frame, cm)."""
        x, y = PARTS[part].points(_PER_STUD).astype(np.float32).T
        inside = np.zeros((len(taps), len(x)), dtype=bool)
        for tap in np.moveaxis(taps.astype(np.float32), 1, 0):  # [N, 2]
            inside |= (tap[:, :1] - x) ** 2 + (tap[:, 1:] - y) ** 2 <= self.firm_radius**2
        return np.asarray(inside.mean(axis=1))
