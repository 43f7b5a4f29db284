"""Poses as arrays: quaternions (w, x, y, z), rotations applied row by row, motions between waypoints.

Rotation algebra is scipy's; this module only fixes the order of the components and the shapes.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from p2l.records import Array

_SCALAR_LAST, _SCALAR_FIRST = [1, 2, 3, 0], [3, 0, 1, 2]  # an index costs a tenth of scipy's own `scalar_first`


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

    The same to the bit as scipy's `(first⁻¹ · second).magnitude()`, which makes four objects where one will do; it runs
    several times at every control step.
    """
    w, x, y, z = _unit(first)
    x, y, z = -x, -y, -z
    a, b, c, d = _unit(second)
    product = np.stack(
        [
            w * b + a * x + (y * d - z * c),
            w * c + a * y + (z * b - x * d),
            w * d + a * z + (x * c - y * b),
            w * a - x * b - y * c - z * d,
        ],
        axis=1,
    )
    return np.asarray(Rotation.from_quat(product).magnitude())


def _unit(quat: Array) -> Array:
    """[4, N] components of unit quaternions along [N, 4]."""
    w, x, y, z = quat.T
    return np.asarray(quat.T / np.sqrt(x * x + y * y + z * z + w * w))


def between(start: Array, end: Array, fraction: Array) -> Array:
    """[N, 4] on the shorter way from `start` to `end` [N, 4]; `fraction` [N] of it.

    Spherical interpolation in place of scipy's `Slerp`, which takes one pair at a time; it runs at every control step.
    """
    dot = (start * end).sum(axis=1)
    angle = np.arccos(np.clip(np.abs(dot), 0.0, 1.0))
    sine = np.sin(angle)
    near = sine < 1e-6
    safe = np.where(near, 1.0, sine)
    first = np.where(near, 1.0 - fraction, np.sin((1.0 - fraction) * angle) / safe)
    second = np.where(near, fraction, np.sin(fraction * angle) / safe) * np.where(dot < 0.0, -1.0, 1.0)
    blend = first[:, None] * start + second[:, None] * end
    return np.asarray(blend / np.linalg.norm(blend, axis=1, keepdims=True))
