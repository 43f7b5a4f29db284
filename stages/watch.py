"""Stage `watch`: film a nominal run, a recorded failure, or a failure beside what a learnt recovery does about it."""

from __future__ import annotations

from pathlib import Path

from p2l.evaluation.video.player import VideoOptions, backend, play
from p2l.failures.discovery import nominal_run, replay
from p2l.failures.record import load_failures, one_failure, open_world
from p2l.schema import WatchConfig
from p2l.seeding import generator
from p2l.tracking import Tracker
from p2l.worlds.table import make_world
from stages._stage import stage


@stage("watch", WatchConfig)
def run(cfg: WatchConfig, out: Path, track: Tracker) -> None:
    """Write `<item>-<what>.mp4` and print its path; nothing is simulated where nothing can be drawn."""
    backend()
    file = out / f"{cfg.item}-{cfg.method}.mp4"
    caption = _execution(cfg, file) if cfg.policy is None else _recovery(cfg, cfg.policy, file)
    track.artifact(file)
    print(f"{file}: {caption}")


def _execution(cfg: WatchConfig, file: Path) -> str:
    """One failure or one nominal run; returns what it shows."""
    if cfg.failure is None:
        world = make_world(cfg.world.key, cfg.world.params)
        start = world.sample(generator(cfg.seed, "watch", world.name), 1)
        path, done = nominal_run(world, world.nominal_options(), start)
        caption = "a nominal run that reaches its goal" if done else "a nominal run that does not reach its goal"
    else:
        one = one_failure(load_failures(cfg.failures), cfg.failure, cfg.world.key, cfg.failures)
        world, nominal = open_world(one, cfg.failures)
        path, done = replay(world, nominal, one)[0], False
        caption = f"failure {cfg.failure}: {one.kind_names()[0]} in {one.option_names()[0]} after {one.time_s[0]:.2f} s"
    play(world, [path], [file], VideoOptions(**cfg.video.model_dump()), failed=not done)
    return caption


def _recovery(cfg: WatchConfig, folder: Path, file: Path) -> str:
    """A failure beside its recovery; returns what it shows."""
    from p2l.chaining.clips import policy_clips  # torch, which no other film needs
    from p2l.evaluation.video.chains import film_side_by_side

    world = make_world(cfg.world.key, cfg.world.params)
    one = None
    if cfg.failure is not None:
        one = one_failure(load_failures(cfg.failures), cfg.failure, cfg.world.key, cfg.failures)
    rng = generator(cfg.seed, "watch", world.name, "recovery")
    clips = policy_clips(world, folder, one, cfg.failures, rng, transfer=cfg.transfer)
    video = VideoOptions(**cfg.video.model_dump())
    return film_side_by_side(file, world, clips.failure, clips.recovery, video, whole_task=clips.whole_task)


if __name__ == "__main__":
    run()
