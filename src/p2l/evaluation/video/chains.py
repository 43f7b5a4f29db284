"""A nominal failure and a learnt recovery side by side, from the same start, with the actions chosen as captions.

On the left the nominal skills alone, which stop where a detector fires; on the right the whole robot (thesis, equation
5.1): the same up to there, then the policy. Time is the same on both sides; who has ended waits for the other.

Axis letters: T control steps, F frames, H and W pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from p2l.chaining.agent import Agent
from p2l.chaining.execute import nominal_part, recover
from p2l.chaining.pool import action_names
from p2l.contracts.option import Option
from p2l.contracts.world import Rows, World
from p2l.errors import ConfigError
from p2l.evaluation.video.player import Camera, Frames, VideoOptions, save_video
from p2l.records import Array, IntArray
from p2l.skills.chain import run
from p2l.skills.runner import Reason

BAND = 0.1  # height of the captions, share of the picture's
INK = (245, 245, 245)


@dataclass(frozen=True)
class Clip:
    """A part of an execution.

    Attributes:
        rows: [T] its moments.
        captions: [T] what is being done.
        actions: options or primitives that were begun, in order.
        told: how it ended.
        done: whether the task is done.
        flagged: whether a detector ended it.
    """

    rows: Rows
    captions: tuple[str, ...]
    actions: tuple[str, ...]
    told: str
    done: bool
    flagged: bool = False


def flagged_start(world: World, nominal: Sequence[Option], rng: np.random.Generator, most: int = 256) -> Rows:
    """The first of up to `most` drawn starts from which a detector fires.

    Raises:
        ConfigError: none of them.
    """
    starts = world.sample(rng, most)
    for part in np.array_split(np.arange(most), max(most // 16, 1)):
        flagged = nominal_part(world, nominal, starts.take(part), slots=len(part)).last.reason == Reason.FAILED
        if flagged.any():
            return starts.take(part[flagged][:1])
    raise ConfigError(f"none of {most} nominal runs of '{world.name}' was flagged: there is nothing to recover from")


def nominal_clip(world: World, nominal: Sequence[Option], start: Rows) -> Clip:
    """The nominal skills from `start` [1], to their end or to where a detector fires.

    Raises:
        ConfigError: the simulation breaks down.
    """
    kept: dict[int, Rows] = {0: start}

    def watch(_: IntArray, step: IntArray, rows: Rows) -> None:
        kept[int(step[0])] = rows

    done = run(world, nominal, start, slots=1, watch=watch)
    if done.diverged[0]:
        raise ConfigError(f"the simulation of this start of '{world.name}' breaks down; choose another")
    running = np.minimum(np.searchsorted(done.ends.step, np.arange(len(kept)), side="right"), len(done.ends) - 1)
    captions = tuple(f"nominal: {_plain(nominal[int(option)].name)}" for option in done.ends.option[running])
    failed = int(done.last.reason[0]) == Reason.FAILED
    told = "task done" if done.success[0] else "ended without success"
    if failed:
        seconds = float(done.last.step[0]) * world.engine.control_period_s
        kind = _plain(world.failure_kinds[int(done.last.kind[0])])
        told = f"failure: {kind} in {_plain(nominal[int(done.last.option[0])].name)} after {seconds:.1f} s"
    names = tuple(nominal[option].name for option in done.ends.option.tolist())
    return Clip(Rows.join(list(kept.values())), captions, names, told, bool(done.success[0]), failed)


def recovery_clip(world: World, nominal: Sequence[Option], agent: Agent, start: Rows) -> Clip:
    """The agent from `start` [1], to the end of its episode."""
    kept, begun = [start], []

    def act(observation: Array) -> IntArray:
        begun.append(len(kept))
        return agent.act(observation)

    found = recover(world, nominal, replace(agent, act=act), start, lambda _, rows: kept.append(rows))
    own = tuple(primitive.name for primitive in agent.primitives)
    names = [(*own, *action_names((), nominal))[action] for action in found.actions[0].tolist() if action >= 0]
    decision = np.searchsorted(begun, np.arange(1, len(kept)), side="right")
    captions = [f"recovery {number}: {_plain(names[number - 1])}" for number in decision.tolist()]
    told = "recovered: task done" if found.success[0] else "not recovered"
    return Clip(Rows.join(kept), (captions[0], *captions), tuple(names), told, bool(found.success[0]))


def film_side_by_side(
    file: Path, world: World, failure: Clip, recovery: Clip, options: VideoOptions, *, whole_task: bool = False
) -> None:
    """Write the video.

    Args:
        file: `.mp4` to write.
        world: of the rows.
        failure: the nominal skills alone.
        recovery: what the policy did, from where they failed; from the start where it does the whole task.
        options: of each side; `max_frames` counts the longer one.
        whole_task: see `recovery`.

    Raises:
        NoGLError: nothing to draw with.
    """
    length = max(len(failure.rows), len(recovery.rows)) if whole_task else len(failure.rows) + len(recovery.rows)
    every = -(-length // options.max_frames)
    view = replace(world.view, lookat_m=world.view.lookat_m or _middle(world, failure.rows, recovery.rows))
    with Camera(world, replace(options, max_frames=length, hold_s=0.0), view) as camera:
        left, after = (_captioned(camera, clip, every) for clip in (failure, recovery))
    right = after if whole_task else left[:-1] + after
    fps = 1.0 / (every * world.engine.control_period_s)
    count = max(len(left), len(right)) + round(options.hold_s * fps)
    pairs = [(left[min(k, len(left) - 1)], right[min(k, len(right) - 1)]) for k in range(count)]
    save_video(file, np.stack([np.concatenate(pair, axis=1) for pair in pairs]), fps)


def _captioned(camera: Camera, clip: Clip, every: int) -> list[Frames]:
    """Frames of a clip; the last one says how it ended, framed in red where that is a failure."""
    shown = [*range(0, len(clip.rows) - 1, every), len(clip.rows) - 1]
    pictures, _ = camera.film(clip.rows.take(shown), failed=not clip.done)
    texts = [*(clip.captions[step] for step in shown[:-1]), clip.told]
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


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _middle(world: World, *paths: Rows) -> tuple[float, float, float]:
    """Of where the hand goes."""
    way = np.concatenate([path.sensors[:, world.engine.sensor_columns["grip_pos"]] for path in paths])
    x, y, z = 0.5 * (way.min(axis=0) + way.max(axis=0))
    return float(x), float(y), float(z)
