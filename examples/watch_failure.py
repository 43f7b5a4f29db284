"""Find failures of the push world's nominal skills, keep them in a file, open it again and film one of them.

    python -m examples.watch_failure out/

The world lies outside p2l: it is named by its target, and so the file of failures knows how to build it again.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from p2l import make_world
from p2l.evaluation.video.player import VideoOptions, play
from p2l.failures.discovery import find_failures, replay
from p2l.failures.record import STRANDED, Failures, Origin, load_failures, open_world, save_failures

WORLD, PARAMS = "examples.push.world:Push", {"sigma_m": 0.03, "estimator": "fixed"}
EPISODES = 40


def recorded(file: Path) -> Failures:
    """Run the nominal skills, and leave the moments at which a detector fired."""
    world = make_world(WORLD, PARAMS)
    nominal = world.nominal_options()
    names, kinds = tuple(option.name for option in nominal), (*world.failure_kinds, STRANDED)
    origin = Origin(WORLD, PARAMS, world.digest, "first_flag", "train", 0, EPISODES, 10, names, kinds)
    result = find_failures(world, nominal, world.sample(np.random.default_rng(0), EPISODES), origin, slots=16)
    print(f"{result.execution.success.mean():.0%} of {EPISODES} episodes reach the goal")
    save_failures(file, result.failures)
    return load_failures(file)


def main(folder: Path) -> Path:
    """Film the first failure."""
    failures = recorded(folder / "failures.npz")
    first = failures.take([0])
    world, nominal = open_world(failures, folder / "failures.npz")
    film = folder / "failure.mp4"
    play(world, replay(world, nominal, first), [film], VideoOptions(), failed=True)
    print(f"{film}: {first.kind_names()[0]} in {first.option_names()[0]} after {first.time_s[0]:.2f} s")
    return film


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
