"""Videos of each failure mode before and after learning: the way into a failure, and the way out of it.

The failure is a held-out one, the most typical of its mode among those that training could have met. What follows is
what the robot does there with all it has learnt, knowing the state: recoveries and nominal skills, to the goal or to
where it gives up.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from p2l.artifacts import save_json
from p2l.contracts.world import Rows
from p2l.evaluation.video.failures import INDEX, skip
from p2l.evaluation.video.player import NoGLError, VideoOptions, play
from p2l.failures.discovery import replay
from p2l.failures.record import Failures
from p2l.metareskill.learn import Setting
from p2l.metareskill.record import Recoveries
from p2l.metareskill.strategies import Playbook, playbook
from p2l.records import BoolArray, IntArray
from p2l.registry import get_options
from p2l.seeding import generator
from p2l.skills.chain import FINISH, Moments, run
from p2l.skills.execute import known_exactly

log = logging.getLogger(__name__)


def film_recoveries(
    folder: Path, setting: Setting, failures: Failures, recoveries: Recoveries, video: VideoOptions
) -> None:
    """Write `mode_<i>_before.mp4`, `mode_<i>_after.mp4` and `videos.json`, which says what they show.

    A mode without a held-out failure, or from which the robot gives up at once, has fewer. Without a GL there is only
    the index, with the reason.

    Args:
        folder: emptied of videos first.
        setting: world, preconditions and modes.
        failures: held out.
        recoveries: learnt.
        video: how.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.mp4"):
        old.unlink()
    modes, chosen = _typical(setting, failures)
    nominal = get_options(setting.task.world.name, setting.task.world)
    before = replay(setting.task.world, nominal, chosen)
    after, told, solved = _ways_out(setting, chosen, recoveries)
    shown: list[dict[str, Any]] = []
    for place, mode in enumerate(modes.tolist()):
        kind = f"{chosen.kind_names()[place]} in {chosen.option_names()[place]}"
        shown.append({"file": f"mode_{mode}_before.mp4", "mode": mode, "moment": "before", "told": kind})
        if told[place]:
            way = {"told": ", ".join(told[place]), "solved": bool(solved[place])}
            shown.append({"file": f"mode_{mode}_after.mp4", "mode": mode, "moment": "after", **way})
    left = [place for place in range(len(modes)) if told[place]]
    try:
        world = setting.task.world
        play(world, before, [folder / f"mode_{mode}_before.mp4" for mode in modes.tolist()], video, failed=True)
        for place in left:
            file = folder / f"mode_{modes[place]}_after.mp4"
            play(world, [after[place]], [file], video, failed=not solved[place])
    except NoGLError as error:
        log.warning("%s", error)
        skip(folder, str(error))
    else:
        save_json(folder / INDEX, {"videos": shown, "skipped": None}, schema="videos", version=1)


def _typical(setting: Setting, failures: Failures) -> tuple[IntArray, Failures]:
    """The modes that have a held-out failure in which no precondition holds, and the likeliest such one of each."""
    mode, probability = setting.modes.classify(failures.truth)
    lost = np.flatnonzero(~setting.task.holds(failures.rows).any(axis=1))
    modes = np.unique(mode[lost])
    best = [lost[mode[lost] == each][probability[lost[mode[lost] == each]].argmax()] for each in modes.tolist()]
    return modes, failures.take(np.array(best, dtype=np.int64))


def _ways_out(
    setting: Setting, failures: Failures, recoveries: Recoveries
) -> tuple[list[Rows], list[list[str]], BoolArray]:
    """From each failure: rows of every control step, names of the skills executed, and whether the goal is reached."""
    task = setting.task
    nominal = get_options(task.world.name, task.world)
    limit = setting.failures.rows.actions.max() + len(nominal) + 4

    def book() -> Playbook:
        rng, skills = generator(0, "videos", "ties"), recoveries.skills
        graph, timing, modes = recoveries.graph, recoveries.timing, setting.modes
        return playbook("recoveries", task, nominal, graph, timing, rng, modes=modes, skills=skills, max_options=limit)

    rows = known_exactly(failures.rows)
    count = len(rows)
    nothing = np.zeros(count, dtype=np.int64)
    ended = Moments(np.arange(count), rows, failures.option, nothing, nothing - 1, nothing, nothing, np.zeros(count))
    first, found = book().choose(ended), book()  # one that remembers the episodes as they are numbered in its run
    going = np.flatnonzero(first != FINISH)
    paths = [[rows.take([index])] for index in range(count)]
    told: list[list[str]] = [[] for _ in range(count)]
    solved = np.zeros(count, dtype=np.bool_)
    if not len(going):
        return [Rows.join(path) for path in paths], told, solved

    def watch(episode: IntArray, _step: IntArray, now: Rows) -> None:
        for place, index in enumerate(episode.tolist()):
            paths[going[index]].append(now.take([place]))

    made = run(
        task.world, found.options, rows.take(going), first=first[going], choose=found.choose, stop_on_failure=False,
        slots=len(going), watch=watch,
    )  # fmt: skip
    for episode, option in zip(made.ends.episode.tolist(), made.ends.option.tolist(), strict=True):
        told[going[episode]].append(found.options[option].name)
    solved[going] = made.success
    return [Rows.join(path) for path in paths], told, solved
