"""SB3's actor and critic as plain functions on its own weights, and PPO's update with them.

With some three decisions at a time, and minibatches of 60, SB3's modules, its distributions with their checks and its
log cost as much as the arithmetic. This is the same arithmetic in the same order: weights come out as SB3's to the bit,
and its generators (torch's for actions, NumPy's for minibatches) are drawn from in the same way.

Axis letters: K decisions, O observation columns, A actions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.policies import ActorCriticPolicy
from torch.nn import functional

from p2l.chaining.policy import CLIP

_LEAST = torch.finfo(torch.float32).min
Layers = Sequence[tuple[torch.Tensor, torch.Tensor]]


@dataclass(frozen=True)
class ActorCritic:
    """Two networks of tanh layers on the same standardised observation; all are SB3's tensors, not copies.

    Attributes:
        centre, scale: [O] of the standardisation.
        actor: weight and bias of each layer; the last has A outputs.
        critic: the same; the last has one.
    """

    centre: torch.Tensor
    scale: torch.Tensor
    actor: Layers
    critic: Layers

    @classmethod
    def of(cls, policy: ActorCriticPolicy) -> ActorCritic:
        """The networks of an `MlpPolicy` with `chaining.ppo.Standardise` and discrete actions."""
        features = policy.features_extractor
        parts = (policy.mlp_extractor.policy_net, policy.action_net), (policy.mlp_extractor.value_net, policy.value_net)
        actor, critic = (
            [(one.weight, one.bias) for part in pair for one in part.modules() if isinstance(one, torch.nn.Linear)]
            for pair in parts
        )
        centre, scale = features.get_buffer("centre"), features.get_buffer("scale")
        return cls(centre, scale, actor, critic)

    def standard(self, observation: torch.Tensor) -> torch.Tensor:
        """[K, O] (observation − centre) / scale, within ± CLIP."""
        return ((observation - self.centre) / self.scale).clamp(-CLIP, CLIP)

    def log_probs(self, standard: torch.Tensor) -> torch.Tensor:
        """[K, A] of all actions, from standardised observations [K, O]."""
        logits = _outputs(self.actor, standard)
        return logits - logits.logsumexp(dim=-1, keepdim=True)

    def values(self, standard: torch.Tensor) -> torch.Tensor:
        """[K] of standardised observations [K, O]."""
        return _outputs(self.critic, standard)[:, 0]

    def decide(self, observation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """[K] actions drawn by torch's generator, values and log-probabilities, all without a gradient."""
        with torch.inference_mode():
            standard = self.standard(observation)
            log_probs = self.log_probs(standard)
            action = torch.multinomial(functional.softmax(log_probs, dim=-1), 1, replacement=True)
            return action[:, 0], self.values(standard), log_probs.gather(-1, action)[:, 0]


@dataclass(frozen=True)
class UpdateSettings:
    """Of one update; see `chaining.ppo.PPOSettings`."""

    batch_size: int
    n_epochs: int
    clip_range: float
    ent_coef: float
    vf_coef: float
    max_grad_norm: float


def update(
    networks: ActorCritic, optimiser: torch.optim.Optimizer, buffer: RolloutBuffer, settings: UpdateSettings
) -> None:
    """Passes over a full buffer of one environment, in minibatches drawn by NumPy's global generator, as SB3 draws."""
    count = buffer.buffer_size
    standard = networks.standard(torch.from_numpy(buffer.observations.reshape(count, -1)))
    action = torch.from_numpy(buffer.actions.reshape(count, 1).astype(np.int64))
    old, advantage, target = (
        torch.from_numpy(values.reshape(count)) for values in (buffer.log_probs, buffer.advantages, buffer.returns)
    )
    parameters = [tensor for group in optimiser.param_groups for tensor in group["params"]]  # in SB3's order
    for _ in range(settings.n_epochs):
        order = torch.from_numpy(np.random.permutation(count))  # noqa: NPY002 (which a checkpoint holds)
        for batch in order.split(settings.batch_size):
            given = standard[batch], action[batch], old[batch], advantage[batch], target[batch]
            loss = _loss(networks, *given, settings)
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(parameters, settings.max_grad_norm)
            optimiser.step()


def _loss(
    networks: ActorCritic,
    standard: torch.Tensor,
    action: torch.Tensor,
    old: torch.Tensor,
    advantage: torch.Tensor,
    target: torch.Tensor,
    settings: UpdateSettings,
) -> torch.Tensor:
    """Clipped surrogate, entropy and squared error of the critic; the order of the sums is SB3's."""
    log_probs = networks.log_probs(standard)
    log_prob = log_probs.gather(-1, action)[:, 0]
    value = networks.values(standard)
    entropy = -(log_probs.clamp(min=_LEAST) * functional.softmax(log_probs, dim=-1)).sum(-1)
    if len(advantage) > 1:
        advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    ratio = torch.exp(log_prob - old)
    clipped = torch.clamp(ratio, 1 - settings.clip_range, 1 + settings.clip_range)
    surrogate = -torch.min(advantage * ratio, advantage * clipped).mean()
    error = functional.mse_loss(target, value)
    return surrogate + settings.ent_coef * -torch.mean(entropy) + settings.vf_coef * error


def _outputs(layers: Layers, features: torch.Tensor) -> torch.Tensor:
    for weight, bias in layers[:-1]:
        features = functional.linear(features, weight, bias).tanh()
    return functional.linear(features, *layers[-1])
