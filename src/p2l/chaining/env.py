"""The RecoveryChaining MDP as gymnasium and stable-baselines3 know environments, for users of other learners.

`RecoveryEnv` is one episode at a time. A `step` of `RecoveryVectorEnv` and of `RecoveryVecEnv` is synchronous by
contract: it lasts until every row's action has ended. With `send` and `recv`, the names that EnvPool gave them,
rows of the former do not wait for each other; neither do they in `ppo`, which asks the pool itself.

1. A bound on an episode's length is a truncation, as in both libraries; for `ppo` it is a termination.

Axis letters: B rows, O observation columns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from stable_baselines3.common.vec_env import VecEnv

from p2l.chaining.mdp import Starts, Transitions
from p2l.chaining.pool import Pool
from p2l.contracts.rows import Rows
from p2l.records import Array

Obs = npt.NDArray[np.float32]
MakePool = Callable[[Starts, int], Pool]


def spaces(pool: Pool) -> tuple[gymnasium.Space[Any], gymnasium.Space[Any]]:
    """Observation space and action space of the pool."""
    bound = np.full(len(pool.columns), np.inf, dtype=np.float32)
    return gymnasium.spaces.Box(-bound, bound), gymnasium.spaces.Discrete(len(pool.actions))


class RecoveryEnv(gymnasium.Env[Obs, int]):
    """One recovery episode at a time.

    Args:
        make: a pool from its starts and its number of slots.
        failures: what episodes start at, at random.
    """

    def __init__(self, make: MakePool, failures: Rows) -> None:
        self._pool = make(lambda n: failures.take(self.np_random.integers(len(failures), size=n)), 1)
        self.observation_space, self.action_space = spaces(self._pool)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Obs, dict[str, Any]]:
        """A failure drawn by `seed`."""
        super().reset(seed=seed, options=options)
        self._pool.reset()
        return self._pool.observation[0].astype(np.float32), {}

    def step(self, action: int) -> tuple[Obs, float, bool, bool, dict[str, Any]]:
        """Execute one action to its end; `info` has its control steps and whether the task is done."""
        transitions = _play(self._pool, np.array([action]))
        cut = bool(transitions.cut[0])
        info = {"control_steps": int(transitions.steps[0]), "is_success": bool(transitions.done[0])}
        return (
            transitions.observation[0].astype(np.float32),
            float(transitions.reward[0]),
            bool(transitions.over[0]) and not cut,
            cut,
            info,
        )


class RecoveryVectorEnv(VectorEnv[Obs, npt.NDArray[np.int64], npt.NDArray[Any]]):
    """B episodes; one that ends starts over at once, its last observation in `final_obs`.

    All rows act together in `step`. Without waiting: `send` actions to rows that are not busy, and `recv` the
    transitions of those whose action has ended, `info["env_id"]` says which:

        obs, _ = env.reset(seed=0)
        env.send(policy(obs), np.arange(env.num_envs))
        while training:
            obs, reward, terminated, truncated, info = env.recv()
            env.send(policy(obs), info["env_id"])

    Args:
        make: a pool from its starts and its number of slots.
        failures: what episodes start at, at random.
        rows: B.
    """

    metadata = {  # noqa: RUF012 (gymnasium declares it for instances)
        "autoreset_mode": AutoresetMode.SAME_STEP
    }

    def __init__(self, make: MakePool, failures: Rows, rows: int) -> None:
        self.num_envs = rows
        self._pool = make(lambda n: failures.take(self.np_random.integers(len(failures), size=n)), rows)
        self.single_observation_space, self.single_action_space = spaces(self._pool)
        self.observation_space = batch_space(self.single_observation_space, rows)
        self.action_space = batch_space(self.single_action_space, rows)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Obs, dict[str, Any]]:
        """Failures drawn by `seed`."""
        super().reset(seed=seed, options=options)
        self._pool.reset()
        return self._pool.observation.astype(np.float32), {}

    def step(
        self, actions: npt.NDArray[np.int64]
    ) -> tuple[Obs, Array, npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Execute one action in every row, to its end.

        Raises:
            ConfigError: a row is busy, or there is no such action.
        """
        return _answer(_play(self._pool, np.asarray(actions, dtype=np.int64)))

    def send(self, actions: npt.NDArray[np.int64], env_id: npt.NDArray[np.int64]) -> None:
        """Start `actions` [K] in the rows `env_id` [K].

        Raises:
            ConfigError: one of the rows is busy or named twice, or there is no such row or action.
        """
        self._pool.act(np.asarray(env_id), np.asarray(actions, dtype=np.int64))

    def recv(self) -> tuple[Obs, Array, npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Transitions [K] of the rows, at least one, whose action ends first.

        Raises:
            ConfigError: no row is busy.
        """
        return _answer(self._pool.poll())


def _answer(
    transitions: Transitions,
) -> tuple[Obs, Array, npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
    """Transitions in the form of gymnasium's `step`."""
    info: dict[str, Any] = {
        "env_id": transitions.slot,
        "control_steps": transitions.steps,
        "is_success": transitions.done,
    }
    if transitions.over.any():
        last = np.empty(len(transitions.slot), dtype=object)
        for row in np.flatnonzero(transitions.over):
            last[row] = transitions.observation[row].astype(np.float32)
        info |= {"final_obs": last, "_final_obs": transitions.over}
    return (
        transitions.next_observation.astype(np.float32),
        transitions.reward,
        transitions.over & ~transitions.cut,
        transitions.cut,
        info,
    )


class RecoveryVecEnv(VecEnv):
    """The same for stable-baselines3.

    Args:
        pool: whose slots are the rows.
    """

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._actions = np.zeros(len(pool), dtype=np.int64)
        super().__init__(len(pool), *spaces(pool))

    def reset(self) -> Obs:
        """A new episode in every row."""
        self._pool.reset()
        return self._pool.observation.astype(np.float32)

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Remember the actions."""
        self._actions = np.asarray(actions, dtype=np.int64)

    def step_wait(self) -> tuple[Obs, npt.NDArray[np.float32], npt.NDArray[np.bool_], list[dict[str, Any]]]:
        """Execute them to their ends."""
        transitions = _play(self._pool, self._actions)
        infos: list[dict[str, Any]] = [
            {"control_steps": steps, "is_success": done}
            for steps, done in zip(transitions.steps, transitions.done, strict=True)
        ]
        for row in np.flatnonzero(transitions.over):
            infos[row] |= {
                "terminal_observation": transitions.observation[row].astype(np.float32),
                "TimeLimit.truncated": bool(transitions.cut[row]),
            }
        return (
            transitions.next_observation.astype(np.float32),
            transitions.reward.astype(np.float32),
            transitions.over,
            infos,
        )

    def close(self) -> None:
        """There is nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Rows have no attributes of their own."""
        return [getattr(self, attr_name, None)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Rows have no attributes of their own."""
        raise NotImplementedError(f"rows of a pool share everything; there is no '{attr_name}' to set")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Rows have no methods of their own."""
        raise NotImplementedError(f"rows of a pool have no method '{method_name}'")

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Any = None
    ) -> list[bool]:
        """Never."""
        del wrapper_class
        return [False] * len(list(self._get_indices(indices)))


def _play(pool: Pool, actions: npt.NDArray[np.int64]) -> Transitions:
    """One action in every slot, to its end; ordered by slot."""
    pool.act(np.arange(len(pool)), actions)
    parts: list[Transitions] = []
    while sum(len(part.slot) for part in parts) < len(pool):
        parts.append(pool.poll())
    return _by_slot(parts)


def _by_slot(parts: Sequence[Transitions]) -> Transitions:
    """One batch of transitions, ordered by slot."""
    order = np.argsort(np.concatenate([part.slot for part in parts]))
    names = Transitions.__dataclass_fields__
    return Transitions(**{name: np.concatenate([getattr(part, name) for part in parts])[order] for name in names})
