"""Videos: what is drawn is where things are, and where nothing can be drawn one message says what to install."""

import json
import logging

import imageio_ffmpeg
import numpy as np
import pytest

from p2l import gl
from p2l.artifacts import load_json
from p2l.contracts.world import View
from p2l.evaluation.video import player as videos
from p2l.evaluation.video.failures import film
from p2l.evaluation.video.player import Camera, NoGLError, VideoOptions, backend, save_video
from p2l.failures.discovery import replay
from tests.failures.pushing import found

SMALL = VideoOptions(width=96, height=64, max_frames=5, hold_s=0.5)
ABOVE = View(azimuth_deg=90.0, elevation_deg=-89.0, distance_m=0.5, lookat_m=(0.0, 0.0, 0.0))


def no_gl():
    try:
        backend()
    except NoGLError as error:
        return str(error)
    return ""


drawing = pytest.mark.skipif(bool(no_gl()), reason=no_gl())


@pytest.fixture
def fresh(monkeypatch):
    """Forget which backend was found, before and after."""
    backend.cache_clear()
    yield monkeypatch
    monkeypatch.undo()
    backend.cache_clear()


@pytest.fixture(scope="module")
def pushed():
    return found("pessimistic", sigma_m=0.03, episodes=12)


def read(path):
    """[F, H, W, 3] and frames per second of a video."""
    reader = imageio_ffmpeg.read_frames(str(path))
    meta = next(reader)
    width, height = meta["size"]
    return np.stack([np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]), meta["fps"]


@drawing
def test_a_body_is_drawn_where_its_state_says(pushed):
    """Seen from above, moving the block along x moves the pixels that change along the picture's width."""
    world, _, made = pushed
    start = made.failures.start
    moved = start.take([0, 0, 0])
    for index, x in enumerate((-0.08, 0.0, 0.08)):
        moved.states[index, 1:4] = [x, 0.0, 0.03]
        moved.states[index, 8:11] = [0.0, -0.4, 0.03]  # the hand, out of sight
    with Camera(world, VideoOptions(96, 64, 5, 0.0), ABOVE) as camera:
        frames, _ = camera.film(moved)
        empty = moved.take([0])
        empty.states[0, 1:4] = [5.0, 5.0, 0.03]
        [bare], _ = camera.film(empty)
    changed = np.abs(frames.astype(int) - bare).sum(axis=3) > 20
    columns = [np.flatnonzero(one.any(axis=0)).mean() for one in changed]
    assert np.diff(columns) == pytest.approx([columns[2] - columns[1]] * 2, abs=2.0)
    assert columns[2] - columns[0] > 15


@drawing
def test_a_video_is_in_real_time_and_ends_framed_in_red(pushed, tmp_path):
    world, options, made = pushed
    two = made.failures.take([0, 1])
    film(tmp_path, ["one", "two"], world, two, replay(world, options, two), SMALL)
    frames, fps = read(tmp_path / "one.mp4")
    steps = int(made.failures.step[0])
    every = -(-(steps + 1) // SMALL.max_frames)
    assert fps == pytest.approx(20 / every, rel=0.01)
    assert len(frames) == len(range(0, steps, every)) + 1 + round(0.5 * fps)
    red = [frame[:2, :, 0].mean() - frame[:2, :, 1].mean() > 80 for frame in frames]
    assert red == [False] * len(range(0, steps, every)) + [True] * (1 + round(0.5 * fps))
    index = load_json(tmp_path / "videos.json", schema="videos", version=1)
    assert [one["file"] for one in index["videos"]] == ["one.mp4", "two.mp4"]
    assert index["videos"][0]["kind"] in ("missed", "stranded")
    assert index["skipped"] is None


@drawing
def test_equal_frames_give_equal_files(tmp_path):
    frames = np.random.default_rng(0).integers(0, 255, (6, 64, 96, 3), dtype=np.uint8)
    for name in ("one.mp4", "two.mp4"):
        save_video(tmp_path / name, frames, 10.0)
    assert (tmp_path / "one.mp4").read_bytes() == (tmp_path / "two.mp4").read_bytes()


def test_without_a_gl_the_work_goes_on_without_videos(pushed, tmp_path, fresh, caplog):
    """A display driver that is not there, for real: EGL finds no vendor."""
    world, options, made = pushed
    fresh.setattr(videos, "BACKENDS", ("egl",))
    one = made.failures.take([0])
    (tmp_path / "old.mp4").write_bytes(b"of an earlier run")
    fresh.setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nowhere")
    with caplog.at_level(logging.WARNING):
        film(tmp_path, ["one"], world, one, replay(world, options, one), SMALL)
    assert "libegl1 libgl1-mesa-dri (or libosmesa6)" in caplog.text
    assert [path.name for path in tmp_path.iterdir()] == ["videos.json"]
    index = json.loads((tmp_path / "videos.json").read_text())
    assert (index["videos"], "to have them: apt install" in index["skipped"].lower()) == ([], True)


def test_drawing_may_be_switched_off(fresh):
    fresh.setattr(gl, "CHOICE", "disable")
    with pytest.raises(NoGLError, match="MUJOCO_GL=disable; unset it"):
        backend()
