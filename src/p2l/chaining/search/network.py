"""The network of the deployed policy, learnt from what a model would choose (behaviour cloning).

Axis letters: K decisions, O state columns, A actions.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import nn

from p2l.chaining.policy import CLIP, Card, Policy
from p2l.records import Array, IntArray


def clone(
    card: Card,
    states: Array,
    actions: IntArray,
    weights: Array,
    hidden: Sequence[int],
    *,
    updates: int,
    batch: int,
    seed: int,
) -> Policy:
    """The policy that chooses `actions` [K] in `states` [K, O], in half precision, as PPO's are written.

    Args:
        card: of the policy.
        states: [K, O].
        actions: [K].
        weights: [K] how much each of them counts.
        hidden: sizes of the hidden layers.
        updates: of Adam, whose step falls to 0.
        batch: decisions of an update.
        seed: of first weights and batches.
    """
    generator = torch.Generator().manual_seed(seed & (2**63 - 1))
    sizes = [len(card.columns), *hidden, len(card.actions)]
    layers = [nn.Linear(one, other) for one, other in pairwise(sizes)]
    for layer in layers:
        nn.init.orthogonal_(layer.weight, gain=2**0.5, generator=generator)
        nn.init.zeros_(layer.bias)
    network = nn.Sequential(*[part for layer in layers for part in (layer, nn.Tanh())][:-1])
    scale = card.normalisation
    inputs = torch.tensor(np.clip((states - scale.centre) / scale.scale, -CLIP, CLIP), dtype=torch.float32)
    targets, shares = torch.tensor(actions), torch.tensor(weights / weights.mean(), dtype=torch.float32)
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-3)
    falling = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 0.01, total_iters=updates)
    for _ in range(updates):
        some = torch.randint(len(inputs), (min(batch, len(inputs)),), generator=generator)
        losses = nn.functional.cross_entropy(network(inputs[some]), targets[some], reduction="none")
        loss = (shares[some] * losses).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        falling.step()
    parts: dict[str, torch.Tensor] = {}
    for index, layer in enumerate(layers):
        parts |= {f"w{index}": layer.weight.detach().half(), f"b{index}": layer.bias.detach().half()}
    return Policy(card, parts)
