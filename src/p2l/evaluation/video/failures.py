"""Videos of recorded failures, with a note of what they show or why there is none."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

from p2l.artifacts import save_json
from p2l.contracts.option import Option
from p2l.contracts.world import World
from p2l.evaluation.video.player import NoGLError, VideoOptions, play
from p2l.failures.discovery import replay
from p2l.failures.record import Failures

log = logging.getLogger(__name__)
INDEX = "videos.json"


def film(
    folder: Path, names: Sequence[str], world: World, options: Sequence[Option], failures: Failures, video: VideoOptions
) -> None:
    """Write `<name>.mp4` of the way to each failure, and `videos.json`; without a GL only the latter, with the reason.

    Args:
        folder: emptied of videos first.
        names: of the files, one per failure.
        world: of the failures.
        options: its nominal chain.
        failures: what to film.
        video: how.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.mp4"):
        old.unlink()
    shown = [
        {"file": f"{name}.mp4", "option": option, "kind": kind, "episode": int(episode), "time_s": float(time_s)}
        for name, option, kind, episode, time_s in zip(
            names, failures.option_names(), failures.kind_names(), failures.episode, failures.time_s, strict=True
        )
    ]
    try:
        files = [folder / f"{name}.mp4" for name in names]
        play(world, replay(world, options, failures), files, video, failed=True)
    except NoGLError as error:
        log.warning("%s", error)
        skip(folder, str(error))
    else:
        save_json(folder / INDEX, {"videos": shown, "skipped": None}, schema="videos", version=1)


def skip(folder: Path, reason: str) -> None:
    """Note that there are no videos, and why."""
    folder.mkdir(parents=True, exist_ok=True)
    save_json(folder / INDEX, {"videos": [], "skipped": reason}, schema="videos", version=1)
