"""RecoveryChaining in one call, for programs that bring a learner of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from p2l.chaining.env import RecoveryEnv, RecoveryVecEnv, RecoveryVectorEnv
from p2l.chaining.learner import no_failures
from p2l.chaining.mdp import Limits, Starts
from p2l.chaining.pool import Pool
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.failures.record import Failures, check_world


@dataclass(frozen=True)
class RecoveryChaining:
    """The recovery MDP of a world's failures (thesis, section 5.3.2), as environments of both libraries.

    Attributes:
        world: where.
        failures: [N] what episodes start at.
        primitives: the policy's own actions.
        nominal: the chain, each controller a terminal action.
        limits: bounds of an episode.
    """

    world: World
    failures: Rows
    primitives: tuple[Option, ...]
    nominal: tuple[Option, ...]
    limits: Limits

    @property
    def actions(self) -> tuple[str, ...]:
        """Names, the primitives first."""
        return self._pool(lambda n: self.failures.take(np.zeros(n, dtype=np.int64)), 1).actions

    def env(self) -> RecoveryEnv:
        """For gymnasium: one episode at a time."""
        return RecoveryEnv(self._pool, self.failures)

    def vector_env(self, rows: int) -> RecoveryVectorEnv:
        """For gymnasium: `rows` episodes at once."""
        return RecoveryVectorEnv(self._pool, self.failures, rows)

    def vec_env(self, rows: int, seed: int = 0) -> RecoveryVecEnv:
        """For stable-baselines3: `rows` episodes at once, whose failures are drawn by `seed`."""
        rng = np.random.default_rng(seed)
        return RecoveryVecEnv(self._pool(lambda n: self.failures.take(rng.integers(len(self.failures), size=n)), rows))

    def _pool(self, starts: Starts, slots: int) -> Pool:
        return Pool(self.world, self.nominal, self.primitives, starts, slots, self.limits)


def recovery_chaining(
    world: World,
    failures: Failures,
    *,
    primitives: Sequence[Option] | None = None,
    limits: Limits | None = None,
) -> RecoveryChaining:
    """The recovery MDP of recorded failures.

    Args:
        world: in which they were found.
        failures: of `discover`, or read from a file.
        primitives: the policy's own actions; the world's without any.
        limits: bounds of an episode; those of the thesis without any.

    Raises:
        ArtifactError: no failure, or failures of another world.

    Example:
        >>> from p2l import discover, make_world, recovery_chaining
        >>> world = make_world("pick_place", {"nthread": 1})
        >>> mdp = recovery_chaining(world, discover(world, 40, seed=1))
        >>> env = mdp.env()
        >>> observation, _ = env.reset(seed=0)
        >>> mdp.actions[0], mdp.actions[-1], observation.shape == env.observation_space.shape
        ('move +x', 'from place', True)
    """
    check_world(failures, world, "recovery_chaining")
    if not len(failures):
        raise no_failures(world.name)
    own = world.primitives() if primitives is None else tuple(primitives)
    return RecoveryChaining(world, failures.rows, own, world.nominal_options(), limits or Limits())
