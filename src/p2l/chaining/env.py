"""The RecoveryChaining MDP as gymnasium and stable-baselines3 know environments, for users of other learners.

`RecoveryEnv` is one episode at a time. A `step` of `RecoveryVectorEnv` and of `RecoveryVecEnv` is synchronous by
contract: it lasts until every row's action has played out. With `send` and `recv`, the names that EnvPool gave them,
rows of the former do not wait for each other; neither do they in `ppo`, which asks the pool itself.

1. A bound on an episode's length is told as truncation, as both libraries have it; `ppo` takes it for the end.

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

Seen = npt.NDArray[np.float32]
MakePool = Callable[[Starts, int], Pool]


def spaces(pool: Pool) -> tuple[gymnasium.Space[Any], gymnasium.Space[Any]]:
    """What a policy of the pool sees and may do."""
    bound = np.full(len(pool.columns), np.inf, dtype=np.float32)
    return gymnasium.spaces.Box(-bound, bound), gymnasium.spaces.Discrete(len(pool.actions))


class RecoveryEnv(gymnasium.Env[Seen, int]):
    """One recovery episode at a time.

    Args:
        make: a pool from its starts and its number of slots.
        failures: what episodes start at, at random.
    """

    def __init__(self, make: MakePool, failures: Rows) -> None:
        self._pool = make(lambda n: failures.take(self.np_random.integers(len(failures), size=n)), 1)
        self.observation_space, self.action_space = spaces(self._pool)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """A failure drawn by `seed`."""
        super().reset(seed=seed, options=options)
        self._pool.reset()
        return self._pool.observation[0].astype(np.float32), {}

    def step(self, action: int) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Play one action out; `info` has its control steps and whether the task is done."""
        told = _play(self._pool, np.array([action]))
        cut = bool(told.cut[0])
        info = {"control_steps": int(told.steps[0]), "is_success": bool(told.done[0])}
        return told.observation[0].astype(np.float32), float(told.reward[0]), bool(told.over[0]) and not cut, cut, info


class RecoveryVectorEnv(VectorEnv[Seen, npt.NDArray[np.int64], npt.NDArray[Any]]):
    """B episodes; one that ends starts over at once, its last observation in `final_obs`.

    All rows act together in `step`. Without waiting: `send` actions to rows that are not busy, and `recv` those whose
    action has played out, `info["env_id"]` says which:

        seen, _ = env.reset(seed=0)
        env.send(policy(seen), np.arange(env.num_envs))
        while training:
            seen, reward, ended, cut, info = env.recv()
            env.send(policy(seen), info["env_id"])

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

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """Failures drawn by `seed`."""
        super().reset(seed=seed, options=options)
        self._pool.reset()
        return self._pool.observation.astype(np.float32), {}

    def step(
        self, actions: npt.NDArray[np.int64]
    ) -> tuple[Seen, Array, npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Play one action out in every row.

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

    def recv(self) -> tuple[Seen, Array, npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """The rows, at least one, whose action plays out first; all arrays are theirs [K].

        Raises:
            ConfigError: no row is busy.
        """
        return _answer(self._pool.poll())


def _answer(told: Transitions) -> tuple[Seen, Array, npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
    """What has played out, as gymnasium tells it."""
    info: dict[str, Any] = {"env_id": told.slot, "control_steps": told.steps, "is_success": told.done}
    if told.over.any():
        last = np.empty(len(told.slot), dtype=object)
        for row in np.flatnonzero(told.over):
            last[row] = told.observation[row].astype(np.float32)
        info |= {"final_obs": last, "_final_obs": told.over}
    return told.next_observation.astype(np.float32), told.reward, told.over & ~told.cut, told.cut, info


class RecoveryVecEnv(VecEnv):
    """The same for stable-baselines3.

    Args:
        pool: whose slots are the rows.
    """

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._actions = np.zeros(len(pool), dtype=np.int64)
        super().__init__(len(pool), *spaces(pool))

    def reset(self) -> Seen:
        """A new episode in every row."""
        self._pool.reset()
        return self._pool.observation.astype(np.float32)

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Remember the actions."""
        self._actions = np.asarray(actions, dtype=np.int64)

    def step_wait(self) -> tuple[Seen, npt.NDArray[np.float32], npt.NDArray[np.bool_], list[dict[str, Any]]]:
        """Play them out."""
        told = _play(self._pool, self._actions)
        infos: list[dict[str, Any]] = [
            {"control_steps": steps, "is_success": done} for steps, done in zip(told.steps, told.done, strict=True)
        ]
        for row in np.flatnonzero(told.over):
            infos[row] |= {
                "terminal_observation": told.observation[row].astype(np.float32),
                "TimeLimit.truncated": bool(told.cut[row]),
            }
        return told.next_observation.astype(np.float32), told.reward.astype(np.float32), told.over, infos

    def close(self) -> None:
        """Nothing is held."""

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
    return _ordered(parts)


def _ordered(parts: Sequence[Transitions]) -> Transitions:
    order = np.argsort(np.concatenate([part.slot for part in parts]))
    names = Transitions.__dataclass_fields__
    return Transitions(**{name: np.concatenate([getattr(part, name) for part in parts])[order] for name in names})
