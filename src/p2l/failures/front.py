"""Discovery in one call, for programs; the stage `discover` does the same and keeps it in files."""

from __future__ import annotations

from collections.abc import Callable

from p2l.contracts.world import World
from p2l.errors import ConfigError
from p2l.failures.discovery import find_failures
from p2l.failures.record import SPLITS, STRANDED, Failures, Origin
from p2l.failures.strategy import STRATEGIES
from p2l.seeding import generator


def discover(
    world: World,
    episodes: int,
    seed: int = 0,
    *,
    strategy: str = "first_flag",
    split: str = "train",
    max_options: int = 10,
    slots: int = 64,
    progress: Callable[[int], None] | None = None,
) -> Failures:
    """Run the nominal skills under uncertainty and keep their failures (thesis, section 4.3.1).

    Args:
        world: where; with the estimator that `strategy` means (`p2l.failures.strategy`).
        episodes: how many.
        seed: of their start states; equal seeds give equal failures.
        strategy: `first_flag` (a detector speaks), `early_termination` or `pessimistic`.
        split: `train` or `held_out`, which has other start states.
        max_options: of an episode under `early_termination`.
        slots: episodes at once.
        progress: called with the number of episodes finished since the last call.

    Raises:
        ConfigError: no episode, an unknown strategy or split.

    Example:
        >>> from p2l import discover, make_world
        >>> world = make_world("pick_place", {"nthread": 1})
        >>> failures = discover(world, 40, seed=1)
        >>> set(failures.kind_names()) <= {*world.failure_kinds, "stranded"}
        True
    """
    if episodes < 1:
        raise ConfigError(f"discover: {episodes} episodes asked for; it needs at least one")
    for what, name, known in (("strategy", strategy, tuple(STRATEGIES)), ("split", split, SPLITS)):
        if name not in known:
            raise ConfigError(f"discover: unknown {what} '{name}'; known: {', '.join(known)}")
    nominal = world.nominal_options()
    origin = Origin(
        world=world.name,
        params={},
        digest=world.digest,
        strategy=strategy,
        split=split,
        seed=seed,
        executions=episodes,
        max_options=max_options,
        options=tuple(option.name for option in nominal),
        kinds=(*world.failure_kinds, STRANDED),
    )
    starts = world.sample(generator(seed, "discover", world.name, split), episodes)
    return find_failures(world, nominal, starts, origin, slots=slots, progress=progress).failures
