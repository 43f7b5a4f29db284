"""Reader of public facility location instances, for benchmarks and for comparison with the literature."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from p2l.errors import InputError
from p2l.records import Array


def read_instance(path: Path | str) -> tuple[Array, Array]:
    """Opening costs [F] and service costs [D, F] of an instance in OR-Library's or UflLib's text format.

    OR-Library: `m n`, then per warehouse `capacity opening`, then per customer its demand and m service costs.
    UflLib: `FILE: name`, `m n 0`, then per facility its number, opening cost and n service costs.

    Raises:
        InputError: a file that is missing, or too short, or holds something that is no number.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError.at(path, None, None, "no such file; give an OR-Library or UflLib instance")
    words = path.read_text(encoding="utf-8").split()
    try:
        if words[:1] == ["FILE:"]:
            return _ufllib(words[2:])
        return _orlib(words)
    except (ValueError, IndexError) as error:
        raise InputError.at(path, None, None, f"is neither in OR-Library's nor in UflLib's format ({error})") from error


def _orlib(words: list[str]) -> tuple[Array, Array]:
    facilities, demands = int(words[0]), int(words[1])
    opening = np.array(words[3 : 2 + 2 * facilities : 2], dtype=np.float64)  # beside each a number or "capacity"
    rows = np.array(words[2 + 2 * facilities :], dtype=np.float64).reshape(demands, facilities + 1)
    return opening, np.ascontiguousarray(rows[:, 1:])


def _ufllib(words: list[str]) -> tuple[Array, Array]:
    facilities, demands = int(words[0]), int(words[1])
    rows = np.array(words[3:], dtype=np.float64).reshape(facilities, demands + 2)
    return np.ascontiguousarray(rows[:, 1]), np.ascontiguousarray(rows[:, 2:].T)
