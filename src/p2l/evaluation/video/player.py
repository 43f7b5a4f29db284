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
from p2l.contracts.world import View, World
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
        name = backend()
        os.environ.pop("PYOPENGL_PLATFORM", None)
        self.world, self.options, self.view = world, options, view or world.view
        self._context: Any = importlib.import_module(f"mujoco.{name}").GLContext(options.width, options.height)
        self._context.make_current()
        self._drawers: dict[int, Drawer] = {}

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
        self._context.free()

    def film(self, path: Rows, *, failed: bool = False) -> tuple[Frames, float]:
        """[F, H, W, 3] of the rows [T] of one execution, in order, the last one included; and frames per second."""
        every = -(-len(path) // self.options.max_frames)
        fps = 1.0 / (every * self.world.engine.control_period_s)
        steps = [*range(0, len(path) - 1, every), len(path) - 1]
        grip = self.world.engine.sensor_columns["grip_pos"]
        way = path.sensors[:, grip]
        lookat = np.asarray(self.view.lookat_m or 0.5 * (way.min(axis=0) + way.max(axis=0)))
        frames = [self._draw(path.states[step], int(path.model[step]), lookat) for step in steps]
        if failed:
            frames[-1] = _with_red_edge(frames[-1])
        return np.stack(frames + [frames[-1]] * round(self.options.hold_s * fps)), fps

    def _draw(self, state: Array, model: int, lookat: Array) -> Frames:
        from p2l.sim.drawer import Drawer  # tables and figures of finished runs load no simulator

        if model not in self._drawers:
            size = self.options.width, self.options.height
            self._drawers[model] = Drawer(
                self.world.engine, self.world.visual_model(model), *size, self.options.samples
            )
        view = self.view
        return self._drawers[model].draw(state, lookat, view.azimuth_deg, view.elevation_deg, view.distance_m)


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
