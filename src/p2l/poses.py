"""Poses as arrays: quaternions (w, x, y, z), rotations applied row by row, motions between waypoints.

Rotation algebra is scipy's; this module fixes the order of the components and the shapes. What runs at every control
step (`unit`, `inverse`, `product`, `image`, `angle`, `canonical`) is scipy's arithmetic on plain arrays, to the bit and
without its objects, whose checks cost more than the numbers. All of it is element by element, so that a row alone comes
to the same as among others.

Axis letters: N rows.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from p2l.records import Array

_SCALAR_LAST, _SCALAR_FIRST = [1, 2, 3, 0], [3, 0, 1, 2]  # an index costs a tenth of scipy's own `scalar_first`

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])
# The nine entries of a rotation matrix, row by row, as sums of four terms: products of two components, times a factor.
_W, _X, _Y, _Z = range(4)
_TERMS = (
    ((_X, _X, 1), (_Y, _Y, -1), (_Z, _Z, -1), (_W, _W, 1)),
    ((_X, _Y, 2), (_Z, _W, -2), (_W, _W, 0), (_W, _W, 0)),
    ((_X, _Z, 2), (_Y, _W, 2), (_W, _W, 0), (_W, _W, 0)),
    ((_X, _Y, 2), (_Z, _W, 2), (_W, _W, 0), (_W, _W, 0)),
    ((_X, _X, -1), (_Y, _Y, 1), (_Z, _Z, -1), (_W, _W, 1)),
    ((_Y, _Z, 2), (_X, _W, -2), (_W, _W, 0), (_W, _W, 0)),
    ((_X, _Z, 2), (_Y, _W, -2), (_W, _W, 0), (_W, _W, 0)),
    ((_Y, _Z, 2), (_X, _W, 2), (_W, _W, 0), (_W, _W, 0)),
    ((_X, _X, -1), (_Y, _Y, -1), (_Z, _Z, 1), (_W, _W, 1)),
)
_ENTRIES = np.array([[4 * first + second for first, second, _ in entry] for entry in _TERMS]).T  # [4 terms, 9 entries]
_ENTRY_SIGNS = np.array([[float(factor) for *_, factor in entry] for entry in _TERMS]).T


def rotation(quat: Array) -> Rotation:
    """Rotations of quaternions [..., 4]."""
    return Rotation.from_quat(np.asarray(quat)[..., _SCALAR_LAST])


def rotate(rot: Rotation, vectors: npt.ArrayLike) -> Array:
    """[N, 3] vectors [N, 3], or one [3], turned by N rotations or by one.

    In place of scipy's `apply`: with AVX-512 its einsum rounds a row alone otherwise than the same row among others,
    and a restored failure would not go on to the bit.
    """
    matrix, points = rot.as_matrix(), np.asarray(vectors, dtype=np.float64)
    x, y, z = (matrix[..., axis] * points[..., axis, None] for axis in range(3))
    return np.asarray(x + y + z)


def quat(rot: Rotation) -> Array:
    """[..., 4] of rotations, w ≥ 0."""
    return np.asarray(rot.as_quat(canonical=True)[..., _SCALAR_FIRST])


def about(axis: npt.ArrayLike, angle_rad: npt.ArrayLike) -> Rotation:
    """Rotations about one axis [3] (unit) or an axis each [N, 3], by angles [N] or one angle."""
    return Rotation.from_rotvec(np.atleast_1d(angle_rad)[..., None] * np.asarray(axis, dtype=np.float64))


def frame(x_axis: Array, z_axis: Array) -> Array:
    """[N, 4] orientation of frames with these axes [N, 3], orthonormal to start with."""
    columns = np.stack([x_axis, np.cross(z_axis, x_axis), z_axis], axis=-1)
    return quat(Rotation.from_matrix(columns))


def angle(first: Array, second: Array) -> Array:
    """[N] between two orientations [N, 4], rad.

    The same to the bit as scipy's `(first⁻¹ · second).magnitude()`, which makes four objects where one will do.
    """
    turn = _product(inverse(unit(first)), unit(second))
    return np.asarray(Rotation.from_quat(turn[:, _SCALAR_LAST]).magnitude())


def unit(quat: Array) -> Array:
    """[N, 4] unit quaternions along [N, 4]."""
    square = quat * quat
    return np.asarray(quat / np.sqrt(square[:, 1] + square[:, 2] + square[:, 3] + square[:, 0])[:, None])


def inverse(quat: Array) -> Array:
    """[N, 4] of unit quaternions [N, 4]."""
    return quat * _CONJUGATE


def product(first: Array, second: Array) -> Array:
    """[N, 4] of the rotations by `second`, then by `first`; unit quaternions [N, 4], either may be one row for all."""
    return unit(_product(first, second))


def image(quat: Array, vectors: npt.ArrayLike) -> Array:
    """[N, 3] vectors [N, 3], or one [3], turned by unit quaternions [N, 4]; `rotate` without an object."""
    terms = (quat[:, :, None] * quat[:, None, :]).reshape(-1, 16)[:, _ENTRIES] * _ENTRY_SIGNS
    matrix = (terms[:, 0] + terms[:, 1] + terms[:, 2] + terms[:, 3]).reshape(-1, 3, 3)
    parts = matrix * np.asarray(vectors, dtype=np.float64)[..., None, :]
    return np.asarray(parts[..., 0] + parts[..., 1] + parts[..., 2])


def canonical(quat: Array) -> Array:
    """[N, 4] the same orientations with w ≥ 0, as `quat` gives them."""
    w, x, y, z = quat.T
    sign = np.where(w != 0.0, w, np.where(x != 0.0, x, np.where(y != 0.0, y, z)))
    return np.where((sign < 0.0)[:, None], -quat, quat)


def _product(first: Array, second: Array) -> Array:
    w, x, y, z = first.T
    a, b, c, d = second.T
    return np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + a * x + (y * d - z * c),
            w * c + a * y + (z * b - x * d),
            w * d + a * z + (x * c - y * b),
        ],
        axis=1,
    )


def between(start: Array, end: Array, fraction: Array) -> Array:
    """[N, 4] on the shorter way from `start` to `end` [N, 4]; `fraction` [N] of it.

    Spherical interpolation in place of scipy's `Slerp`, which takes one pair at a time; it runs at every control step.
    """
    dot = (start * end).sum(axis=1)
    angle = np.arccos(np.minimum(np.abs(dot), 1.0))
    sine = np.sin(angle)
    near = sine < 1e-6
    safe = np.where(near, 1.0, sine)
    first = np.where(near, 1.0 - fraction, np.sin((1.0 - fraction) * angle) / safe)
    second = np.where(near, fraction, np.sin(fraction * angle) / safe) * np.where(dot < 0.0, -1.0, 1.0)
    blend = first[:, None] * start + second[:, None] * end
    return np.asarray(blend / np.sqrt((blend * blend).sum(axis=1, keepdims=True)))
