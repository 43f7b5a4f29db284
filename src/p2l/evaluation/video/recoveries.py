"""Videos of each failure mode before and after learning: the way into a failure, and the way out of it."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from p2l.artifacts import save_json
from p2l.contracts.world import World
from p2l.evaluation.video.failures import INDEX, empty_folder, skip
from p2l.evaluation.video.player import NoGLError, VideoOptions, play
from p2l.metareskill.clips import ModeClips

log = logging.getLogger(__name__)


def film_recoveries(folder: Path, world: World, clips: ModeClips, video: VideoOptions) -> None:
    """Write `mode_<i>_before.mp4`, `mode_<i>_after.mp4` and `videos.json`, which says what they show.

    A mode from which the robot gives up at once has no second one. Without a GL there is only the index, with the
    reason.

    Args:
        folder: emptied of videos first.
        world: where.
        clips: to show.
        video: how.
    """
    empty_folder(folder)
    videos: list[dict[str, Any]] = []
    for place, mode in enumerate(clips.modes):
        before = {"file": f"mode_{mode}_before.mp4", "mode": mode, "moment": "before", "told": clips.kinds[place]}
        videos.append(before)
        if clips.skills[place]:
            way = {"told": ", ".join(clips.skills[place]), "solved": clips.solved[place]}
            videos.append({"file": f"mode_{mode}_after.mp4", "mode": mode, "moment": "after", **way})
    try:
        play(world, clips.before, [folder / f"mode_{mode}_before.mp4" for mode in clips.modes], video, failed=True)
        for place, mode in enumerate(clips.modes):
            if clips.skills[place]:
                file = folder / f"mode_{mode}_after.mp4"
                play(world, [clips.after[place]], [file], video, failed=not clips.solved[place])
    except NoGLError as error:
        log.warning("%s", error)
        skip(folder, str(error))
    else:
        save_json(folder / INDEX, {"videos": videos, "skipped": None}, schema="videos", version=1)
