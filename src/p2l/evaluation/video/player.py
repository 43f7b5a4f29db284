"""Videos of executions: states drawn off screen by EGL, else OSMesa, and written as H.264.

Without a GL nothing fails: `backend` says what to install, and its caller continues without videos. Drawing in software
takes 30 to 60 ms a frame of 320 × 240, so videos are small and show every few control steps, in real time.

Axis letters: T control steps, F frames, H and W pixels.
"""

from __future__ import annotations

import functools
import importlib
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from p2l import gl
from p2l.artifacts import atomic
from p2l.contracts.rows import Rows
from p2l.contracts.world import Pictured, Scenic, View, World
from p2l.errors import P2LError
from p2l.records import Array

if TYPE_CHECKING:
    from p2l.sim.drawer import Drawer

Frames = npt.NDArray[np.uint8]
BACKENDS = ("egl", "osmesa")
INSTALL = "apt install libegl1 libgl1-mesa-dri (or libosmesa6)"
_PROBE = "import mujoco.{0} as gl; context = gl.GLContext(8, 8); context.make_current(); context.free()"
_RED = np.array([200, 40, 40], dtype=np.uint8)


class NoGLError(P2LError):
    """There is no way to draw off screen; the message says what to install."""


@dataclass(frozen=True)
class VideoOptions:
    """How a video looks.

    Attributes:
        width, height: pixels.
        max_frames: of the motion, which runs in real time; long executions skip control steps.
        hold_s: how long the last frame stays, framed in red where it is a failure.
        samples: of a pixel, against ragged edges; 0 draws twice as fast as 4.
    """

    width: int = 320
    height: int = 240
    max_frames: int = 30
    hold_s: float = 1.0
    samples: int = 4


@functools.cache
def backend() -> str:
    """The first of `BACKENDS` that can draw here; one that `MUJOCO_GL` names goes first.

    Tried in processes of their own: a library that fails to load cannot be unloaded, and spoils the next one's.

    Raises:
        NoGLError: none.
    """
    if gl.CHOICE in ("0", "off", "false", "disable", "disabled"):
        raise NoGLError(f"no videos: MUJOCO_GL={gl.CHOICE}; unset it to draw them")
    problems: dict[str, str] = {}
    for name in sorted(BACKENDS, key=lambda name: name != gl.CHOICE):
        if (problem := _probe(name)) is None:
            return name
        problems[name] = problem
    reasons = "; ".join(f"{name}: {problem}" for name, problem in problems.items())
    raise NoGLError(f"no videos: neither EGL nor OSMesa can draw here ({reasons}). To have them: {INSTALL}")


def _probe(name: str) -> str | None:
    """What goes wrong with a library, or None."""
    environment = {key: value for key, value in os.environ.items() if key not in ("PYOPENGL_PLATFORM", "MUJOCO_GL")}
    command = [sys.executable, "-c", _PROBE.format(name)]
    try:
        process = subprocess.run(
            command, env=environment | {"MUJOCO_GL": name}, capture_output=True, text=True, timeout=60
        )
    except subprocess.TimeoutExpired:
        return "no answer in 60 s"
    lines = [line for line in process.stderr.splitlines() if line.strip() and not line.startswith(("Exception", " "))]
    return None if process.returncode == 0 else (lines[-1][:120] if lines else f"exit code {process.returncode}")


class Camera:
    """Draws rows of one world; holds a GL context, so close it.

    Args:
        world: whose rows are drawn.
        options: size of the frames.
        view: where from; the world's own without it.

    Raises:
        NoGLError: nothing to draw with.
    """

    def __init__(self, world: World, options: VideoOptions, view: View | None = None) -> None:
        self.world, self.options = world, options
        self._drawers: dict[int, Drawer] = {}
        self._context: Any = None
        name = backend()
        if isinstance(world, Scenic):
            os.environ.pop("PYOPENGL_PLATFORM", None)
            self.view = view or world.view
            self._context = importlib.import_module(f"mujoco.{name}").GLContext(options.width, options.height)
            self._context.make_current()
        elif not isinstance(world, Pictured):
            raise NoGLError(f"no videos: world '{world.name}' has neither an engine of ours nor a method `pictures`")

    def __enter__(self) -> Camera:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the GL context back."""
        for drawer in self._drawers.values():
            drawer.close()
        self._drawers.clear()
        if self._context is not None:
            self._context.free()

    def film(self, path: Rows, *, failed: bool = False) -> tuple[Frames, float]:
        """[F, H, W, 3] of the rows [T] of one execution, in order, the last one included; and frames per second."""
        every = -(-len(path) // self.options.max_frames)
        fps = 1.0 / (every * self.world.control_period_s)
        steps = [*range(0, len(path) - 1, every), len(path) - 1]
        if isinstance(self.world, Scenic):
            lookat = np.asarray(self.view.lookat_m or middle(self.world, path))
            frames = [self._draw(self.world, path.states[step], int(path.model[step]), lookat) for step in steps]
        elif isinstance(self.world, Pictured):
            frames = [self._resized(picture) for picture in self.world.pictures(path.take(steps), backend())]
        if failed:
            frames[-1] = _with_red_edge(frames[-1])
        return np.stack(frames + [frames[-1]] * round(self.options.hold_s * fps)), fps

    def _resized(self, picture: Frames) -> Frames:
        from PIL import Image

        size = self.options.width, self.options.height
        return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.BILINEAR), dtype=np.uint8)

    def _draw(self, world: Scenic, state: Array, model: int, lookat: Array) -> Frames:
        from p2l.sim.drawer import Drawer  # tables and figures of finished runs load no simulator

        if model not in self._drawers:
            size = self.options.width, self.options.height
            self._drawers[model] = Drawer(world.engine, world.visual_model(model), *size, self.options.samples)
        view = self.view
        return self._drawers[model].draw(state, lookat, view.azimuth_deg, view.elevation_deg, view.distance_m)


def middle(world: Scenic, *paths: Rows) -> tuple[float, float, float]:
    """Of where the hand goes, world frame, m."""
    way = np.concatenate([path.sensors[:, world.engine.sensor_columns["grip_pos"]] for path in paths])
    x, y, z = 0.5 * (way.min(axis=0) + way.max(axis=0))
    return float(x), float(y), float(z)


def save_video(path: Path | str, frames: Frames, fps: float) -> None:
    """Write an H.264 `.mp4` that browsers play; width and height must be even."""
    import imageio_ffmpeg

    height, width = frames.shape[1:3]
    quiet = ["-crf", "30", "-movflags", "+faststart", "-bitexact", "-threads", "1"]
    with atomic(path) as temporary:
        writer = imageio_ffmpeg.write_frames(
            str(temporary), (width, height), fps=fps, codec="libx264", quality=None, macro_block_size=2,
            output_params=quiet,
        )  # fmt: skip
        writer.send(None)
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
        writer.close()


def play(world: World, paths: Sequence[Rows], files: Sequence[Path], options: VideoOptions, *, failed: bool) -> None:
    """One video of each path.

    Raises:
        NoGLError: nothing to draw with; no file is written.
    """
    with Camera(world, options) as camera:
        for path, file in zip(paths, files, strict=True):
            save_video(file, *camera.film(path, failed=failed))


def _with_red_edge(frame: Frames) -> Frames:
    picture = frame.copy()
    for edge in (np.s_[:4], np.s_[-4:], np.s_[:, :4], np.s_[:, -4:]):
        picture[edge] = _RED
    return picture
