"""By which strategy a recovery gets out of a failure (thesis, sections 5.4.1 and 5.4.2), and how often each pays.

The thesis names the strategies without saying how they were told apart; the definitions are in `strategy`.

Axis letters: N recoveries.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from p2l import poses
from p2l.contracts.world import Rows, World
from p2l.evaluation.statistics import wilson_interval
from p2l.evaluation.team.tables import COLUMNS, Row
from p2l.evaluation.thesis import Thesis
from p2l.records import BoolArray, IntArray

TABLE = "strategies_5"
MOVED_M = 0.01  # half of a primitive
LIFTED_M = 0.05  # bread that is higher above the floor is in the hand


def strategy(world: World, before: Rows, after: Rows, primitives: IntArray) -> list[str]:
    """[N] what a recovery has done between the failure and its last decision, by the state it brought about.

    In `pick_place`: `turn`: the orientation that the nominal skills would keep is a quarter turn about the vertical
    off the one at the failure (half turns are the same to the fingers). `push`: the bread still lies in its bin, and
    its distance to the nearest wall has grown by more than `MOVED_M`. On the shelves: `up` and `inside`: the hand is
    higher, or deeper in the direction of the shelf, by more than `MOVED_M`. Anywhere: `at_once` if control is handed
    back without any primitive, `other` for none of these.

    Args:
        world: where.
        before: [N] the failures.
        after: [N] the moments of the last decisions.
        primitives: [N] how many were taken.
    """
    tests = _tests(world, before, after)
    names = []
    for row, count in enumerate(primitives.tolist()):
        true = [name for name, holds in tests.items() if holds[row]]
        names.append("at_once" if not count else "+".join(true) or "other")
    return names


def _tests(world: World, before: Rows, after: Rows) -> dict[str, BoolArray]:
    was, now = world.privileged(before), world.privileged(after)
    if world.name == "pick_place":
        from p2l.worlds.pick_place.skills import quarter_turn  # needs robosuite, which tables alone do without
        from p2l.worlds.pick_place.world import BIN1_POS_M, BIN_INNER_HALF_M, FLOOR_M

        axes = [
            poses.rotate(poses.rotation(quarter_turn(world.observe(rows))), [1.0, 0.0, 0.0])[:, :2]
            for rows in (before, after)
        ]
        room = [
            (BIN_INNER_HALF_M - np.abs(one["object_pos_m"][:, :2] - BIN1_POS_M[:2])).min(axis=1) for one in (was, now)
        ]
        lies = now["object_pos_m"][:, 2] < FLOOR_M + LIFTED_M
        return {
            "turn": np.abs((axes[0] * axes[1]).sum(axis=1)) < 0.5,
            "push": lies & (room[1] - room[0] > MOVED_M),
        }
    if world.name in ("shelf", "cluttered_shelf"):
        moved = now["grip_pos_m"] - was["grip_pos_m"]
        return {"up": moved[:, 2] > MOVED_M, "inside": moved[:, 1] > MOVED_M}
    return {}


def strategies_5(world: str, reuse: pd.DataFrame, thesis: Thesis) -> pd.DataFrame:
    """Of every strategy, `share`: of the recovered failures; `recovery`: of the failures it was tried on (Wilson).

    Args:
        world: name of the item.
        reuse: rows of `chain_reuse`, of all seeds.
        thesis: for the column of its numbers.
    """
    rows: list[Row] = []
    for learner, part in reuse.groupby("learner", sort=False):
        done = part["success"].astype(bool)
        for name in sorted(set(part["strategy"])):
            mine, setting = part["strategy"] == name, f"world={world};strategy={name}"
            rows.append(_rate(str(learner), setting, "share", int((mine & done).sum()), int(done.sum())))
            rows.append(_rate(str(learner), setting, "recovery", int((mine & done).sum()), int(mine.sum())))
    table = pd.DataFrame(rows, columns=list(COLUMNS[:-1]))
    return thesis.beside(table.astype({"mean": float, "low": float, "high": float, "n": int}), TABLE)


def _rate(method: str, setting: str, metric: str, successes: int, trials: int) -> Row:
    if not trials:
        return method, setting, metric, np.nan, np.nan, np.nan, 0
    low, high = wilson_interval(successes, trials)
    return method, setting, metric, successes / trials, float(low), float(high), trials
