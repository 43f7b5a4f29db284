"""A video of the most novel reuse of a nominal option that paid (figure 5.9): the failure beside its recovery.

Novel is a start outside all states in which the option begins in nominal execution; the most novel is the farthest from
them, in the world's own features of failures.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from p2l.artifacts import save_json
from p2l.chaining.episodes import Agents, start_states
from p2l.contracts.option import Option
from p2l.contracts.world import World
from p2l.evaluation.video.chains import film_side_by_side, nominal_clip, recovery_clip
from p2l.evaluation.video.failures import INDEX, skip
from p2l.evaluation.video.player import NoGLError, VideoOptions

log = logging.getLogger(__name__)
NONE = "no option was started outside the states in which it begins in nominal execution, and paid"


@dataclass(frozen=True)
class Novel:
    """A recovery that reused an option where nominal execution never starts it.

    Attributes:
        learner, seed: whose policy, and of which start states.
        failure: its number among the failures of the seed's episodes.
        option: what was reused.
        off: how far the start is from nominal ones, outside above 1.
    """

    learner: str
    seed: int
    failure: int
    option: str
    off: float


def most_novel(reuse: pd.DataFrame) -> Novel | None:
    """The farthest start that paid, of the rows of `chain_reuse.reuse_of_seed`; None if none was outside."""
    number = reuse.groupby(["learner", "seed"]).cumcount()
    rows = reuse.assign(number=number, off=reuse["off_begun"].astype(float))
    paid = rows[rows["success"].astype(bool) & (rows["option"] != "") & (rows["off"] > 1.0)]
    if paid.empty:
        return None
    one = paid.sort_values("off").iloc[-1]
    return Novel(str(one["learner"]), int(one["seed"]), int(one["number"]), str(one["option"]), float(one["off"]))


def film_reuse(
    folder: Path,
    world: World,
    nominal: Sequence[Option],
    agents: Mapping[int, Agents],
    episodes: pd.DataFrame,
    reuse: pd.DataFrame,
    video: VideoOptions,
) -> list[Path]:
    """Write `reuse.mp4`, and `videos.json`, which says what it shows; without a GL only that, with the reason.

    Args:
        folder: emptied of videos first.
        world: where.
        nominal: the chain.
        agents: by seed and learner.
        episodes: of `chain_episodes.episodes_of_seed`, in which the failures are.
        reuse: of `chain_reuse.reuse_of_seed`.
        video: how.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.mp4"):
        old.unlink()
    if (one := most_novel(reuse)) is None:
        skip(folder, NONE)
        return []
    mine = episodes[(episodes["learner"] == one.learner) & (episodes["seed"] == one.seed)]
    starts = start_states(world, one.seed, len(mine))
    failure = nominal_clip(world, nominal, starts.take(np.flatnonzero(mine["flagged"])[[one.failure]]))
    recovery = recovery_clip(world, nominal, agents[one.seed][one.learner][0], failure.rows.take([-1]))
    file, told = folder / "reuse.mp4", f"{failure.told}; {recovery.told}: {', '.join(recovery.actions)}"
    try:
        film_side_by_side(file, world, failure, recovery, video)
    except NoGLError as error:
        log.warning("%s", error)
        skip(folder, str(error))
        return []
    shown = {"file": file.name, "option": one.option, "off": round(one.off, 3), "seed": one.seed, "told": told}
    save_json(folder / INDEX, {"videos": [shown], "skipped": None}, schema="videos", version=1)
    return [file]
