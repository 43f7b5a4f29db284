"""A video of the most novel successful reuse of a nominal option (figure 5.9): the failure beside its recovery."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from p2l.artifacts import save_json
from p2l.contracts.world import World
from p2l.errors import ArtifactError
from p2l.evaluation.video.chains import film_side_by_side
from p2l.evaluation.video.failures import INDEX, empty_folder, skip
from p2l.evaluation.video.player import NoGLError, VideoOptions

if TYPE_CHECKING:  # clips come from policies, which load torch
    from p2l.chaining.clips import Clip
    from p2l.chaining.reuse import Novel

log = logging.getLogger(__name__)
NONE = "no option was started outside the states in which it begins in nominal execution, and paid"


def film_reuse(
    folder: Path, world: World, novel: Novel | None, clips: Callable[[Novel], tuple[Clip, Clip]], video: VideoOptions
) -> list[Path]:
    """Write `reuse.mp4`, and `videos.json`, which says what it shows; or only the latter, with the reason.

    Args:
        folder: emptied of videos first.
        world: where.
        novel: what is shown; None: there is nothing to show.
        clips: makes the failure and the recovery.
        video: how.
    """
    empty_folder(folder)
    if novel is None:
        skip(folder, NONE)
        return []
    file = folder / "reuse.mp4"
    try:
        caption = film_side_by_side(file, world, *clips(novel), video)
    except (NoGLError, ArtifactError) as error:  # nothing to draw with, or a policy whose weights were not kept
        log.warning("%s", error)
        skip(folder, str(error))
        return []
    entry = {"file": file.name, "option": novel.option, "off": round(novel.off, 3), "seed": novel.seed, "told": caption}
    save_json(folder / INDEX, {"videos": [entry], "skipped": None}, schema="videos", version=1)
    return [file]
