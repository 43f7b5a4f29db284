"""How the predictor sees a pair of tasks: a lesson's and a tested one's.

`difference` (`τ_train − τ_test`) and `concatenation` (`[τ_train, τ_test]`) are the thesis's; both are linear in the
tasks, so a network's first layer sees each task once. `walls` is ours, for tasks with distances to walls on four sides.
A demonstration leans on the wall that is nearest to the lesson's slot and comes back by that wall's distance (thesis,
section 3.5.1), so elsewhere it ends beside the slot by as much as the same side's wall is nearer or farther there. The
difference of all distances hides which of them that is. Where several walls are equally near, which one is leant on is
left to chance, and so is what the skill is worth.

Axis letters: K taught tasks, M tested tasks, F features of a task, D features of a pair, S sides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from p2l.contracts.domain import Encoding
from p2l.errors import ShapeError
from p2l.records import Array

SIDES = ("wall_left_cm", "wall_right_cm", "wall_bottom_cm", "wall_top_cm")
TIE_CM = 0.01  # walls that differ by less are equally near to who demonstrates
PLAY_CM = 0.1  # a part in its slot, to each side: what a shift is large or small against
PAIR_NAMES = ("least_shift", "largest_shift", "walls_that_tie", "lesson_wall_cm")


def is_linear(encoding: Encoding) -> bool:
    """Whether a pair's features are a linear function of those of its tasks."""
    return encoding in ("difference", "concatenation")


def name_in_records(encoding: Encoding, *, chosen: bool) -> str:
    """What records of fitted models say of the encoding; nothing of those that are older than the choice.

    These are of `difference`, and of whatever linear encoding a domain has that offers no other (`chosen` is false).
    """
    return "" if encoding == "difference" or (is_linear(encoding) and not chosen) else encoding


def width(encoding: Encoding, features: int) -> int:
    """D, from the number of a task's features."""
    return {"difference": features, "concatenation": 2 * features}.get(encoding, len(PAIR_NAMES))


def wall_pairs(feature_names: tuple[str, ...], train: Array, test: Array) -> Array:
    """[K, M, 4] what matters of the walls that a lesson can lean on, in the order of `PAIR_NAMES`.

    A shift is how much farther the wall of a side is from the tested slot than from the lesson's: arsinh(cm / 0.1 cm),
    which tells a tenth of a millimetre near zero and does not care for centimetres. Of the sides whose wall is nearest
    to the lesson's slot, these are the shifts of the smallest and of the largest magnitude, the number of sides, and
    the distance of that wall from the lesson's slot. They are the same for both tasks mirrored or turned by a quarter.

    Args:
        feature_names: F names, `SIDES` among them.
        train: [K, F] features of taught tasks.
        test: [M, F] features of tested tasks.

    Raises:
        ShapeError: tasks without distances to walls.
    """
    if missing := [name for name in SIDES if name not in feature_names]:
        raise ShapeError(f"encoding 'walls': needs the task features {', '.join(SIDES)}; these lack {missing}")
    columns = [feature_names.index(name) for name in SIDES]
    lesson, tested = train[:, columns], test[:, columns]
    nearest = lesson.min(axis=1, keepdims=True)
    leant = lesson <= nearest + TIE_CM  # [K, S]
    shift = tested[None] - lesson[:, None]  # [K, M, S]
    size = np.abs(shift)
    smallest = np.where(leant[:, None], size, np.inf).min(axis=2)
    greatest = np.where(leant[:, None], size, -np.inf).max(axis=2)
    # Of two that are as large, the smallest is the nearer wall and the largest the farther one, whatever their sides.
    nearer = (leant[:, None] & (shift <= -smallest[..., None])).any(axis=2)
    farther = (leant[:, None] & (shift >= greatest[..., None])).any(axis=2)
    least, largest = np.where(nearer, -smallest, smallest), np.where(farther, greatest, -greatest)
    picked = [np.arcsinh(value / PLAY_CM) for value in (least, largest)]
    of_lesson = [np.broadcast_to(values[:, None], shift.shape[:2]) for values in (leant.sum(axis=1), nearest[:, 0])]
    return np.stack([*picked, *of_lesson], axis=2).astype(np.float64)


PAIRS: Mapping[str, Callable[[tuple[str, ...], Array, Array], Array]] = {"walls": wall_pairs}
