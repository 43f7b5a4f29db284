"""stable-baselines3's PPO on a pool of slots, with its own collection of rollouts.

1. A rollout is `n_steps` decisions of all slots together (thesis: 120), in SB3's own buffer as if of one environment,
   trajectory after trajectory with `episode_starts` at their heads.
2. Where the rollout ends within a trajectory, γ · V(next state) is added to its last reward. A bound on an episode's
   length ends it for good, unlike SB3's time limits: who has not handed over by then has failed to recover (eq. 5.1).
   With γ · V there, moving to and fro is worth as much as trying, and learners of the shelf settle for it.
3. The entropy bonus is 0.02, the author's 0, and λ is 0.8, SB3's 0.95 (conf/chain_recoveries.yaml). Normalised
   advantages of rollouts without any reward are noise, and the bonus holds against that. Where options end an episode
   and mostly fail, a long λ charges a good motion for the option tried after it; with 0.5, or with pieces of
   trajectories as short as 64 slots leave of 120 decisions, the critic alone credits it, and learning gets stuck.
4. Observations are standardised over the start states, once and for all. Where a learner asks for it, since its
   episodes go far from their starts, the statistics go on with what it meets, as SB3's VecNormalize does; they change
   after an update and not within a rollout, whose log-probabilities would otherwise be of another policy.
5. `num_timesteps` counts simulated control steps, options included, so a budget is one of simulation. A shortcut's
   options count with the steps that they would have taken, so that it makes as many decisions of the same budget as a
   learner without one, and what it spares is a result.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from p2l.chaining.actor_critic import ActorCritic, UpdateSettings, update
from p2l.chaining.env import spaces
from p2l.chaining.mdp import Transitions
from p2l.chaining.policy import Normalisation
from p2l.chaining.pool import Pool
from p2l.chaining.rollout import Decisions, Gatherer
from p2l.chaining.shortcut import Shortcut
from p2l.chaining.standardise import RunningStandardise, Standardise
from p2l.records import Array, IntArray


@dataclass(frozen=True)
class PPOSettings:
    """Those of the thesis's experiments; the others are SB3's defaults.

    Attributes:
        n_steps: decisions of a rollout.
        batch_size: decisions of a minibatch.
        n_epochs: passes over a rollout.
        learning_rate: of Adam.
        clip_range: of the probability ratio.
        ent_coef: weight of the entropy.
        gamma: discount of a decision.
        gae_lambda: of the advantages.
        hidden: sizes of the hidden layers, of the policy and of the value.
    """

    n_steps: int = 120
    batch_size: int = 60
    n_epochs: int = 10
    learning_rate: float = 3e-4
    clip_range: float = 0.2
    ent_coef: float = 0.0
    gamma: float = 0.99
    gae_lambda: float = 0.95
    hidden: tuple[int, ...] = (256, 256)


@dataclass
class RolloutCounts:
    """Counts of one rollout.

    Attributes:
        action_counts: [A] decisions for each action, whatever their episode.
        ended: episodes from recorded failures that ended.
        done: of them, those that are done by the learner's judge.
        revisited: episodes that started at an earlier success, and ended.
        settled: episodes that ended without simulation.
        reward: sum over decisions.
    """

    action_counts: IntArray
    ended: int = 0
    done: int = 0
    revisited: int = 0
    settled: int = 0
    reward: float = 0.0

    def add(self, transitions: Transitions, settled: bool) -> None:
        """Count transitions; `settled`: they were not simulated."""
        self.ended += int((transitions.over & transitions.fresh).sum())
        self.done += int((transitions.done & transitions.over & transitions.fresh).sum())
        self.revisited += int((transitions.over & ~transitions.fresh).sum())
        self.settled += settled * len(transitions.slot)
        self.reward += float(transitions.reward.sum())


class PoolPPO(PPO):
    """PPO whose environment is a pool.

    Args:
        pool: the MDP.
        settings: of the algorithm.
        normalisation: of observations over the start states.
        seed: below 2³²; SB3 seeds Python's, NumPy's and torch's global generators with it.
        shortcut: predicts options that need not be simulated.
        running: the normalisation goes on with the observations of every rollout.
    """

    def __init__(
        self,
        pool: Pool,
        settings: PPOSettings,
        normalisation: Normalisation,
        seed: int,
        shortcut: Shortcut | None = None,
        *,
        running: bool = False,
    ) -> None:
        self.pool, self.shortcut, self._settings = pool, shortcut, settings
        self.gatherer = Gatherer()
        self.round = RolloutCounts(np.zeros(len(pool.actions), dtype=np.int64))
        keywords = {name: value for name, value in vars(settings).items() if name != "hidden"}
        sizes = list(settings.hidden)
        extractor: dict[str, Any] = {"centre": normalisation.centre, "scale": normalisation.scale}
        if running:  # the start states count like a rollout
            extractor |= {"narrowest": normalisation.narrowest, "count": settings.n_steps}
        super().__init__(
            "MlpPolicy",
            DummyVecEnv([lambda: _Spaces(pool)]),
            seed=seed,
            device="cpu",
            policy_kwargs={
                "net_arch": {"pi": sizes, "vf": sizes},
                "features_extractor_class": RunningStandardise if running else Standardise,
                "features_extractor_kwargs": extractor,
                "optimizer_kwargs": {"eps": 1e-5, "fused": True},  # SB3's Adam in one pass over the weights
            },
            **keywords,
        )
        self._networks = ActorCritic.of(self.policy)

    def train(self) -> None:
        """As SB3's, of which it leaves out the log (see `actor_critic`); then the statistics of what it was of."""
        settings = UpdateSettings(
            batch_size=self.batch_size,
            n_epochs=self.n_epochs,
            clip_range=self._settings.clip_range,
            ent_coef=self.ent_coef,
            vf_coef=self.vf_coef,
            max_grad_norm=self.max_grad_norm,
        )
        update(self._networks, self.policy.optimizer, self.rollout_buffer, settings)
        self._n_updates += self.n_epochs
        extractor = self.policy.features_extractor
        if isinstance(extractor, RunningStandardise):
            seen = np.asarray(self.rollout_buffer.observations, dtype=np.float64)
            extractor.include(torch.tensor(seen.reshape(-1, seen.shape[-1])))

    @property
    def normalisation(self) -> Normalisation | None:
        """The present one where it goes on; None where it is that of the start."""
        extractor = self.policy.features_extractor
        if not isinstance(extractor, RunningStandardise):
            return None
        centre, scale = (part.numpy().astype(np.float64) for part in (extractor.centre, extractor.scale))
        return Normalisation(centre, scale, extractor.narrowest)

    @property
    def spared(self) -> int:
        """Control steps that the shortcut has spared so far."""
        return 0 if self.shortcut is None else self.shortcut.spared

    @property
    def budget_steps(self) -> int:
        """Control steps that the budget is charged for so far."""
        return self.pool.control_steps + self.spared

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Fill the buffer with the next `n_rollout_steps` decisions whose actions end, in whatever slot."""
        del env  # its spaces are all that it has
        callback.on_rollout_start()
        self.round = RolloutCounts(np.zeros(len(self.pool.actions), dtype=np.int64))
        while len(self.gatherer) < n_rollout_steps:
            if self.pool.waiting.any():  # also slots whose episode has just been settled
                self._decide(np.flatnonzero(self.pool.waiting))
                continue
            self._add(self.pool.poll())
            self.num_timesteps = self.budget_steps
            callback.update_locals(locals())
            if not callback.on_step():
                return False
        self.num_timesteps = self.budget_steps
        decisions = self.gatherer.take(n_rollout_steps)
        self.round.action_counts = np.bincount(decisions.action, minlength=len(self.pool.actions))
        self._fill(rollout_buffer, decisions)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def _decide(self, slots: IntArray) -> None:
        observation = self.pool.observation[slots]
        action, value, log_prob = self._networks.decide(_tensor(observation))
        actions = action.numpy()
        self.gatherer.decide(slots, observation, actions, value.numpy(), log_prob.numpy())
        if self.shortcut is not None:
            sure = self.shortcut.sure(observation, actions)
            if sure.any():
                self.shortcut.spare(actions[sure])
                self._add(self.pool.settle(slots[sure], np.ones(int(sure.sum()))), settled=True)
            slots, actions = slots[~sure], actions[~sure]
            self.shortcut.begin(slots, observation[~sure], actions)
        if len(slots):
            self.pool.act(slots, actions)

    def _add(self, transitions: Transitions, *, settled: bool = False) -> None:
        self.gatherer.add(transitions)
        self.round.add(transitions, settled)
        if self.shortcut is not None and not settled:
            self.shortcut.end(transitions)

    def _fill(self, buffer: RolloutBuffer, decisions: Decisions) -> None:
        reward = decisions.reward.copy()
        if (cut := decisions.open_end).any():
            with torch.no_grad():
                future = self.policy.predict_values(_tensor(decisions.after[cut])).numpy()[:, 0]
            reward[cut] += self.gamma * future
        buffer.reset()
        columns = {  # as `buffer.add` would, one decision after the other
            "observations": decisions.observation,
            "actions": decisions.action[:, None],
            "rewards": reward,
            "episode_starts": decisions.head,
            "values": decisions.value,
            "log_probs": decisions.log_prob,
        }
        for name, column in columns.items():
            getattr(buffer, name)[:, 0] = column
        buffer.pos, buffer.full = len(reward), True
        buffer.compute_returns_and_advantage(last_values=torch.zeros(1), dones=np.ones(1))  # the last one ends, too


class _Spaces(gymnasium.Env[Array, int]):
    """The spaces that SB3 asks an environment for; steps come from the pool."""

    def __init__(self, pool: Pool) -> None:
        self.observation_space, self.action_space = spaces(pool)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Nothing to start."""
        super().reset(seed=seed, options=options)
        return np.zeros(self.observation_space.shape or (), dtype=np.float32), {}


def _tensor(values: Array) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float32)
