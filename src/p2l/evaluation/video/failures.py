"""Videos of recorded failures, with an index of what they show or the reason why there is none."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

from p2l.artifacts import save_json
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.evaluation.video.player import NoGLError, VideoOptions, play
from p2l.failures.record import Failures

log = logging.getLogger(__name__)
INDEX = "videos.json"


def film(
    folder: Path, names: Sequence[str], world: World, failures: Failures, ways: Sequence[Rows], video: VideoOptions
) -> None:
    """Write `<name>.mp4` of the way to each failure, and `videos.json`; without a GL only the latter, with the reason.

    Args:
        folder: emptied of videos first.
        names: of the files, one per failure.
        world: of the failures.
        failures: what to film.
        ways: the way to each, see `p2l.failures.discovery.replay`.
        video: how.
    """
    empty_folder(folder)
    videos = [
        {"file": f"{name}.mp4", "option": option, "kind": kind, "episode": int(episode), "time_s": float(time_s)}
        for name, option, kind, episode, time_s in zip(
            names, failures.option_names(), failures.kind_names(), failures.episode, failures.time_s, strict=True
        )
    ]
    try:
        files = [folder / f"{name}.mp4" for name in names]
        play(world, ways, files, video, failed=True)
    except NoGLError as error:
        log.warning("%s", error)
        skip(folder, str(error))
    else:
        save_json(folder / INDEX, {"videos": videos, "skipped": None}, schema="videos", version=1)


def empty_folder(folder: Path) -> None:
    """Make the folder, without the videos of an earlier run."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.mp4"):
        old.unlink()


def skip(folder: Path, reason: str) -> None:
    """Note that there are no videos, and why."""
    empty_folder(folder)
    save_json(folder / INDEX, {"videos": [], "skipped": reason}, schema="videos", version=1)
