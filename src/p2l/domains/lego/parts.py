"""Parts made of Lego bricks, and what a camera sees of them (thesis, section 3.5.2 and figure 3.8).

A part is a union of bricks on the stud grid. Lengths are in centimetres. The *part frame* has its origin at the centre
of the part's bounding box and axes along the studs; the *grasp frame* is the frame of the user's bounding box, which
is the part frame up to the user's error.

Deviations from the thesis:
    1. The thesis shows its fifteen parts only as a photograph; these are our own, of the same kind.
    2. The camera is simulated: a part lies at a random place and angle; pixels are blurred, noisy,
       thresholded and despeckled.
    3. The grasp that the user marks fixes the angle of the grasp frame up to a few degrees.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from p2l.records import Array, BoolArray, IntArray

STUD_CM = 0.8


@dataclass(frozen=True)
class Part:
    """A rigid part: `bricks` are (column, row, columns, rows) in studs; bricks may touch or overlap."""

    name: str
    bricks: tuple[tuple[int, int, int, int], ...]

    @cached_property
    def size(self) -> Array:
        """[2] width and height of the bounding box, cm."""
        corners = self._corners_studs
        return (corners[:, 2:].max(axis=0) - corners[:, :2].min(axis=0)) * STUD_CM

    @cached_property
    def rectangles(self) -> Array:
        """[B, 4] low x, low y, high x, high y of each brick in the part frame, cm."""
        corners = self._corners_studs * STUD_CM
        low, high = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
        return corners - np.tile((low + high) / 2, 2)

    @cached_property
    def _corners_studs(self) -> Array:
        bricks = np.array(self.bricks, dtype=np.float64)
        return np.hstack([bricks[:, :2], bricks[:, :2] + bricks[:, 2:]])

    def distance(self, points: Array) -> Array:
        """Distance [...] in cm of points [..., 2] (part frame) to the part; 0 inside."""
        low, high = self.rectangles[:, :2], self.rectangles[:, 2:]
        beyond = np.maximum(np.maximum(low - points[..., None, :], points[..., None, :] - high), 0.0)
        return np.asarray(np.sqrt((beyond**2).sum(axis=-1)).min(axis=-1))

    def points(self, per_stud: int) -> Array:
        """[Q, 2] centres of the cells that tile the part, `per_stud` cells along a stud; part frame, cm."""
        pitch = STUD_CM / per_stud
        axes = [(np.arange(round(length / pitch)) + 0.5) * pitch - length / 2 for length in self.size]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        return np.asarray(grid[self.distance(grid) == 0.0])


PARTS: tuple[Part, ...] = (
    Part("bar_1x12", ((0, 0, 12, 1),)),
    Part("bar_2x12", ((0, 0, 12, 2),)),
    Part("bar_2x16", ((0, 0, 16, 2),)),
    Part("plate_4x8", ((0, 0, 8, 4),)),
    Part("plate_4x10", ((0, 0, 10, 4),)),
    Part("plate_6x10", ((0, 0, 10, 6),)),
    Part("plate_8x8", ((0, 0, 8, 8),)),
    Part("l_8x8", ((0, 0, 8, 2), (0, 2, 2, 6))),
    Part("l_12x6", ((0, 0, 12, 2), (0, 2, 2, 4))),
    Part("t_10x8", ((0, 6, 10, 2), (4, 0, 2, 6))),
    Part("t_8x10", ((0, 8, 8, 2), (3, 0, 2, 8))),
    Part("u_10x8", ((0, 0, 10, 2), (0, 2, 2, 6), (8, 2, 2, 6))),
    Part("s_10x6", ((0, 0, 6, 2), (4, 2, 2, 2), (4, 4, 6, 2))),
    Part("plus_10x10", ((4, 0, 2, 10), (0, 4, 10, 2))),
    Part("steps_10x8", ((0, 0, 4, 4), (3, 2, 4, 4), (6, 4, 4, 4))),
)


@dataclass(frozen=True)
class OverheadCamera:
    """The sensor and the user who marks a part; lengths in cm, angles in radians."""

    pixel: float = 0.2
    field: float = 20.0
    blur: float = 0.7  # standard deviation in pixels
    noise: float = 0.15  # standard deviation of a pixel's value, whose range is 0 to 1
    flips: float = 0.002  # share of pixels that read the opposite
    box: float = 0.1  # standard deviation of each side of the user's bounding box
    angle: float = 0.03  # standard deviation of the grasp's angle
    samples: int = 40  # the crop is resampled to samples x samples


@dataclass(frozen=True)
class Views:
    """M pictures of parts on the table; the first two fields are observed, the last two are hidden truth.

    Attributes:
        image: [M, S, S] the crop in the grasp frame, axes x then y, stretched to a square.
        size: [M, 2] width and height of the marked bounding box, cm.
        offset: [M, 2] centre of the marked box in the part frame, cm.
        angle: [M] angle of the grasp frame in the part frame, radians.
    """

    image: BoolArray
    size: Array
    offset: Array
    angle: Array


def rotate(points: Array, angle: Array) -> Array:
    """Turn points [..., 2] by angle [...] (radians, counter-clockwise)."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = points[..., 0], points[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def photograph(part: Part, camera: OverheadCamera, rng: np.random.Generator, m: int) -> Views:
    """Take m pictures of `part`, each at its own place and angle, and crop them to the user's box."""
    count = round(camera.field / camera.pixel)
    pose = rng.uniform(-1.0, 1.0, (m, 3)) * np.array([1.0, 1.0, np.pi])
    axis = (np.arange(count) + 0.5) * camera.pixel - camera.field / 2
    pixels = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    in_part = rotate(pixels[None] - pose[:, None, None, :2], -pose[:, 2, None, None])
    value = ndimage.gaussian_filter((part.distance(in_part) == 0.0).astype(float), (0.0, camera.blur, camera.blur))
    picture = value + rng.normal(0.0, camera.noise, value.shape) > 0.5
    picture ^= rng.random(value.shape) < camera.flips
    picture = ndimage.median_filter(picture, size=(1, 3, 3))  # lone specks would otherwise be tapped

    sides = rng.normal(0.0, camera.box, (m, 2, 2))  # outward shift of the low and the high sides
    size = part.size + sides.sum(axis=1)
    offset = (sides[:, 1] - sides[:, 0]) / 2
    angle = rng.normal(0.0, camera.angle, m)
    cells = (np.arange(camera.samples) + 0.5) / camera.samples - 0.5
    unit = np.stack(np.meshgrid(cells, cells, indexing="ij"), axis=-1)
    crop = rotate(unit[None] * size[:, None, None], angle[:, None, None]) + offset[:, None, None]
    on_table = rotate(crop, pose[:, 2, None, None]) + pose[:, None, None, :2]
    index: IntArray = np.clip(np.floor((on_table + camera.field / 2) / camera.pixel), 0, count - 1).astype(np.int64)
    image = picture[np.arange(m)[:, None, None], index[..., 0], index[..., 1]]
    return Views(image, size, offset, angle)
