"""A nominal failure and a recovery side by side, from the same start, with the actions as captions.

On the left the nominal skills alone, which stop where a detector fires; on the right the whole robot (thesis, equation
5.1): the same up to there, then the policy. Time is the same on both sides; the shorter one ends with a still picture.

Axis letters: F frames, H and W pixels.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from p2l.contracts.world import Scenic, World
from p2l.evaluation.video.player import Camera, Frames, VideoOptions, middle, save_video

if TYPE_CHECKING:  # a clip comes from a policy, which loads torch
    from p2l.chaining.clips import Clip

BAND = 0.1  # height of the captions, share of the picture's
INK = (245, 245, 245)


def film_side_by_side(
    file: Path, world: World, failure: Clip, recovery: Clip, options: VideoOptions, *, whole_task: bool = False
) -> str:
    """Write the video; returns what it shows, in words.

    Args:
        file: `.mp4` to write.
        world: of the rows.
        failure: the nominal skills alone.
        recovery: by the policy, from the failure; from the start where it does the whole task.
        options: of each side; `max_frames` counts the longer one.
        whole_task: see `recovery`.

    Raises:
        NoGLError: nothing to draw with.
    """
    length = max(len(failure.rows), len(recovery.rows)) if whole_task else len(failure.rows) + len(recovery.rows)
    every = -(-length // options.max_frames)
    view = None
    if isinstance(world, Scenic):
        view = replace(world.view, lookat_m=world.view.lookat_m or middle(world, failure.rows, recovery.rows))
    with Camera(world, replace(options, max_frames=length, hold_s=0.0), view) as camera:
        left, after = (_caption_frames(camera, clip, every) for clip in (failure, recovery))
    right = after if whole_task else left[:-1] + after
    fps = 1.0 / (every * world.control_period_s)
    count = max(len(left), len(right)) + round(options.hold_s * fps)
    pairs = [(left[min(k, len(left) - 1)], right[min(k, len(right) - 1)]) for k in range(count)]
    save_video(file, np.stack([np.concatenate(pair, axis=1) for pair in pairs]), fps)
    return f"{failure.ending}; {recovery.ending}: {', '.join(recovery.actions)}"


def _caption_frames(camera: Camera, clip: Clip, every: int) -> list[Frames]:
    """Frames of a clip; the caption of the last one is the ending, in a red frame where that is a failure."""
    steps = [*range(0, len(clip.rows) - 1, every), len(clip.rows) - 1]
    pictures, _ = camera.film(clip.rows.take(steps), failed=not clip.done)
    texts = [*(clip.captions[step] for step in steps[:-1]), clip.ending]
    return [_with_band(picture, text) for picture, text in zip(pictures, texts, strict=True)]


def _with_band(picture: Frames, text: str) -> Frames:
    """[H + band, W, 3] the picture over a line of text, in letters as large as fit."""
    height, width = picture.shape[:2]
    band = Image.new("RGB", (width, _band(height)))
    draw, largest = ImageDraw.Draw(band), 0.7 * band.height
    share = draw.textlength(text, ImageFont.load_default(largest)) / (0.96 * width)
    font = ImageFont.load_default(max(largest / max(share, 1.0), 6.0))
    draw.text((0.02 * width, band.height / 2), text, INK, font, anchor="lm")
    return np.concatenate([picture, np.asarray(band, dtype=np.uint8)])


def _band(height: int) -> int:
    """Even, as videos want it."""
    return 2 * max(round(BAND * height / 2), 6)
