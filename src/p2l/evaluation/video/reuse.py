"""A video of the most novel reuse of a nominal option that paid (figure 5.9): the failure beside its recovery."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from p2l.artifacts import save_json
from p2l.contracts.world import World
from p2l.evaluation.video.chains import film_side_by_side
from p2l.evaluation.video.failures import INDEX, empty_folder, skip
from p2l.evaluation.video.player import NoGLError, VideoOptions

if TYPE_CHECKING:  # clips come from policies, which load torch
    from p2l.chaining.clips import Clip
    from p2l.chaining.reuse import Novel

log = logging.getLogger(__name__)
NONE = "no option was started outside the states in which it begins in nominal execution, and paid"


def film_reuse(
    folder: Path, world: World, novel: Novel, failure: Clip, recovery: Clip, video: VideoOptions
) -> list[Path]:
    """Write `reuse.mp4`, and `videos.json`, which says what it shows; without a GL only that, with the reason.

    Args:
        folder: emptied of videos first.
        world: where.
        novel: what is shown.
        failure: the nominal skills.
        recovery: that reused one of them.
        video: how.
    """
    empty_folder(folder)
    file = folder / "reuse.mp4"
    try:
        told = film_side_by_side(file, world, failure, recovery, video)
    except NoGLError as error:
        log.warning("%s", error)
        skip(folder, str(error))
        return []
    shown = {"file": file.name, "option": novel.option, "off": round(novel.off, 3), "seed": novel.seed, "told": told}
    save_json(folder / INDEX, {"videos": [shown], "skipped": None}, schema="videos", version=1)
    return [file]
