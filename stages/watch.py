"""Stage `watch`: film a recorded failure, or a nominal run."""

from __future__ import annotations

from pathlib import Path

from p2l.errors import ConfigError
from p2l.evaluation.videos import VideoOptions, backend, play
from p2l.failures.discovery import nominal_run, replay
from p2l.failures.record import load_failures, open_world
from p2l.registry import get_options, get_world
from p2l.schema import WatchConfig
from p2l.seeding import generator
from p2l.tracking import Tracker
from stages._stage import stage


@stage("watch", WatchConfig)
def run(cfg: WatchConfig, out: Path, track: Tracker) -> None:
    """Write `<item>-<what>.mp4` and print its path."""
    backend()  # nothing is simulated where nothing can be drawn
    file = out / f"{cfg.item}-{cfg.method}.mp4"
    if cfg.failure is None:
        world = get_world(cfg.world.name, cfg.world.params)
        options = get_options(world.name, world)
        path, done = nominal_run(world, options, world.sample(generator(cfg.seed, "watch", world.name), 1))
        told = "a nominal run that reaches its goal" if done else "a nominal run that does not reach its goal"
    else:
        failures = load_failures(cfg.failures)
        if failures.origin.world != cfg.world.name:
            raise ConfigError(f"{cfg.failures}: holds failures of '{failures.origin.world}', not of '{cfg.world.name}'")
        if cfg.failure >= len(failures):
            raise ConfigError(f"failure={cfg.failure}: {cfg.failures} holds {len(failures)}, numbered from 0")
        world, options = open_world(failures, cfg.failures)
        one = failures.take([cfg.failure])
        path, done = replay(world, options, one)[0], False
        told = f"failure {cfg.failure}: {one.kind_names()[0]} in {one.option_names()[0]} after {one.time_s[0]:.2f} s"
    play(world, [path], [file], VideoOptions(**cfg.video.model_dump()), failed=not done)
    track.artifact(file)
    print(f"{file}: {told}")


if __name__ == "__main__":
    run()
