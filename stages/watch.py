"""Stage `watch`: film a nominal run, a recorded failure, or a failure beside what a learnt recovery does about it."""

from __future__ import annotations

from pathlib import Path

from p2l.errors import ConfigError
from p2l.evaluation.video.player import VideoOptions, backend, play
from p2l.failures.discovery import nominal_run, replay
from p2l.failures.record import Failures, check_params, load_failures, open_world
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
    told = _recovery(cfg, cfg.policy, file) if cfg.policy else _execution(cfg, file)
    track.artifact(file)
    print(f"{file}: {told}")


def _execution(cfg: WatchConfig, file: Path) -> str:
    """One failure or one nominal run; returns what it shows."""
    if cfg.failure is None:
        world = get_world(cfg.world.name, cfg.world.params)
        options = get_options(world.name, world)
        path, done = nominal_run(world, options, world.sample(generator(cfg.seed, "watch", world.name), 1))
        told = "a nominal run that reaches its goal" if done else "a nominal run that does not reach its goal"
    else:
        one = _recorded(cfg, cfg.failure)
        world, options = open_world(one, cfg.failures)
        path, done = replay(world, options, one)[0], False
        told = f"failure {cfg.failure}: {one.kind_names()[0]} in {one.option_names()[0]} after {one.time_s[0]:.2f} s"
    play(world, [path], [file], VideoOptions(**cfg.video.model_dump()), failed=not done)
    return told


def _recovery(cfg: WatchConfig, folder: Path, file: Path) -> str:
    """A failure beside its recovery; returns what it shows."""
    from p2l.chaining.agent import load_agent
    from p2l.evaluation.video import chains as videos

    world = get_world(cfg.world.name, cfg.world.params)
    nominal, rng = get_options(world.name, world), generator(cfg.seed, "watch", world.name, "recovery")
    some = world.sample(rng, 1)
    agent, _ = load_agent(folder, world, nominal, some, transfer=cfg.transfer)  # refuses before anything is simulated
    if cfg.failure is None:
        start = videos.flagged_start(world, nominal, rng)
    else:
        one = _recorded(cfg, cfg.failure)
        check_params(one, world.name, cfg.world.params, cfg.failures)
        start = one.start
    failure = videos.nominal_clip(world, nominal, start)
    if not failure.flagged:
        raise ConfigError(f"failure={cfg.failure}: no detector fires on its way; a recovery has nothing to take over")
    begin = start if agent.whole_task else failure.rows.take([-1])
    recovery = videos.recovery_clip(world, nominal, agent, begin)
    options = VideoOptions(**cfg.video.model_dump())
    videos.film_side_by_side(file, world, failure, recovery, options, whole_task=agent.whole_task)
    return f"{failure.told}; {recovery.told}: {', '.join(recovery.actions)}"


def _recorded(cfg: WatchConfig, number: int) -> Failures:
    failures = load_failures(cfg.failures)
    if failures.origin.world != cfg.world.name:
        raise ConfigError(f"{cfg.failures}: holds failures of '{failures.origin.world}', not of '{cfg.world.name}'")
    if number >= len(failures):
        raise ConfigError(f"failure={number}: {cfg.failures} holds {len(failures)}, numbered from 0")
    return failures.take([number])


if __name__ == "__main__":
    run()
