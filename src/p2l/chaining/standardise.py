"""The first layer of PPO's networks: standardised observations.

Axis letters: K rows, O observation columns.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from p2l.chaining.policy import CLIP
from p2l.records import Array


class Standardise(BaseFeaturesExtractor):
    """(observation − centre) / scale, within ± CLIP."""

    centre: torch.Tensor
    scale: torch.Tensor

    def __init__(self, observation_space: gymnasium.Space[Any], centre: Array, scale: Array) -> None:
        super().__init__(observation_space, features_dim=len(centre))
        self.register_buffer("centre", torch.tensor(centre, dtype=torch.float32))
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float32))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """[K, O] → [K, O]."""
        return ((observations - self.centre) / self.scale).clamp(-CLIP, CLIP)


class RunningStandardise(Standardise):
    """The same over all observations so far; its statistics are buffers, so that a checkpoint of the network has them.

    Args:
        observation_space: of O columns.
        centre: [O] mean to begin with.
        scale: [O] standard deviation to begin with.
        narrowest: least scale.
        count: how many observations the beginning counts like.
    """

    count: torch.Tensor
    mean: torch.Tensor
    variance: torch.Tensor

    def __init__(
        self, observation_space: gymnasium.Space[Any], centre: Array, scale: Array, narrowest: float, count: int
    ) -> None:
        super().__init__(observation_space, centre, scale)
        self.narrowest = narrowest
        self.register_buffer("count", torch.tensor(float(count), dtype=torch.float64))
        self.register_buffer("mean", torch.tensor(centre, dtype=torch.float64))
        self.register_buffer("variance", torch.tensor(scale, dtype=torch.float64) ** 2)

    def include(self, observations: torch.Tensor) -> None:
        """Go on with [K, O] more (Chan, Golub and LeVeque, 1979)."""
        more = float(len(observations))
        shift = observations.mean(dim=0) - self.mean
        total = self.count + more
        squares = self.count * self.variance + more * observations.var(dim=0, correction=0)
        self.variance.copy_((squares + shift**2 * self.count * more / total) / total)
        self.mean.add_(shift * more / total)
        self.count.copy_(total)
        self.centre.copy_(self.mean)
        self.scale.copy_(self.variance.sqrt().clamp(min=self.narrowest))
