"""The precondition prediction model of the thesis (section 3.3.2): will the skill of one task solve another?

A network with two fully connected layers maps a pair of tasks to a logit. Its input is `τ_train − τ_test` (insertion),
`[τ_train, τ_test]` (Lego), or another encoding of `transfer.encodings`. Axis letters: E members, K taught tasks, M
tested tasks, F features of a task, D of a pair, H hidden units.

Deviations from the thesis:
    1. Targets are success rates of several executions with a binomial likelihood, instead of one binary label.
    2. The model is the mean logit of E networks of different initial weights and folds, then Platt's correction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch

from p2l.artifacts import load_network, save_network
from p2l.contracts.domain import Encoding
from p2l.errors import ArtifactError, ShapeError
from p2l.records import Array
from p2l.transfer.calibration import Platt
from p2l.transfer.encodings import PAIRS, is_linear

SCHEMA = "transfer_model"
Weights = Mapping[str, torch.Tensor]
_CELLS = 25_000  # pairs that pass the hidden layer at once, which bounds the memory of a prediction


@dataclass(frozen=True)
class TransferModel:
    """A fitted predictor.

    Attributes:
        encoding: how a pair of tasks enters.
        feature_names: F names; features of others are refused.
        mean, scale: standardisation, [F] of task features for a linear encoding, else [D] of pair features.
        weights: `w1` [E, D, H], `b1` [E, H], `w2` [E, H], `b2` [E].
        platt: correction of the mean logit.
    """

    encoding: Encoding
    feature_names: tuple[str, ...]
    mean: Array
    scale: Array
    weights: Weights
    platt: Platt

    def checked(self, features: Array) -> Array:
        """Features [M, F] that are fit for this model.

        Raises:
            ShapeError: the number of features differs, or one is not finite.
        """
        values = np.asarray(features, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != len(self.feature_names):
            names = ", ".join(self.feature_names[:4])
            raise ShapeError(
                f"task features have shape {values.shape}; this model takes {len(self.feature_names)} ({names}, …)"
            )
        if not np.isfinite(values).all():
            raise ShapeError("task features hold NaN or infinity")
        return values

    def standardise(self, features: Array) -> Array:
        """Features [M, F] as the network of a linear encoding takes them; see `checked`."""
        return (self.checked(features) - self.mean) / self.scale

    def pairs(self, train: Array, test: Array) -> Array:
        """[K, M, D] standardised features of every pair, as the network sees them; see `checked`."""
        first, second = self.checked(train), self.checked(test)
        if not is_linear(self.encoding):
            return (PAIRS[self.encoding](self.feature_names, first, second) - self.mean) / self.scale
        rows = np.repeat(self.standardise(first)[:, None], len(second), axis=1)
        columns = np.repeat(self.standardise(second)[None], len(first), axis=0)
        return rows - columns if self.encoding == "difference" else np.concatenate([rows, columns], axis=2)

    def logits(self, train: Array, test: Array) -> Array:
        """Uncorrected logits [E, K, M] of features [K, F] of taught and [M, F] of tested tasks."""
        size = max(1, _CELLS // max(1, len(test)))
        with torch.no_grad():
            if is_linear(self.encoding):
                rows, columns = (torch.from_numpy(self.standardise(features)).float() for features in (train, test))
                parts = [pair_logits(self.weights, self.encoding, chunk, columns) for chunk in rows.split(size)]
            else:
                pairs = torch.from_numpy(self.pairs(train, test)).float()
                parts = [network_logits(self.weights, chunk) for chunk in pairs.split(size)]
        return cast(Array, torch.cat(parts, dim=1).numpy().astype(np.float64))

    def predict(self, train: Array, test: Array) -> Array:
        """Probability [K, M] that the skill taught on task k solves task m."""
        return self.platt(self.logits(train, test).mean(axis=0))

    def save(self, path: Path | str, *, domain: str, config_hash: str) -> None:
        """Write weights (safetensors) and card."""
        card = {
            "domain": domain,
            "config_hash": config_hash,
            "encoding": self.encoding,
            "feature_names": list(self.feature_names),
            "mean": self.mean.tolist(),
            "scale": self.scale.tolist(),
            "platt": {"slope": self.platt.slope, "shift": self.platt.shift},
        }
        save_network(path, dict(self.weights), card, schema=SCHEMA)


def load_transfer_model(path: Path | str, *, feature_names: tuple[str, ...], encoding: Encoding) -> TransferModel:
    """Read a model for tasks with these features.

    Raises:
        ArtifactError: missing or damaged, or fitted on other features or another encoding.
    """
    weights, card = load_network(path, schema=SCHEMA)
    for key, value in (("encoding", encoding), ("feature_names", list(feature_names))):
        if card[key] != value:
            raise ArtifactError(
                f"{path}: the model was fitted on domain '{card['domain']}' with {key} {_brief(card[key])}; "
                f"these tasks have {_brief(value)}. Run fit_transfer for this domain."
            )
    correction = Platt(float(card["platt"]["slope"]), float(card["platt"]["shift"]))
    mean, scale = np.array(card["mean"], dtype=float), np.array(card["scale"], dtype=float)
    return TransferModel(encoding, feature_names, mean, scale, weights, correction)


def pair_logits(weights: Weights, encoding: Encoding, train: torch.Tensor, test: torch.Tensor) -> torch.Tensor:
    """Logits [E, K, M] of all pairs of standardised tasks in a linear encoding: taught [K, F] and tested ones [M, F].

    The first layer is linear, so each task passes it once and a pair is a sum.
    """
    w1 = weights["w1"]
    first, second = (w1, -w1) if encoding == "difference" else w1.chunk(2, dim=1)
    activation = torch.matmul(train, first)[:, :, None] + torch.matmul(test, second)[:, None]  # [E, K, M, H]
    activation = torch.relu(activation + weights["b1"][:, None, None])
    return torch.einsum("ekmh,eh->ekm", activation, weights["w2"]) + weights["b2"][:, None, None]


def network_logits(weights: Weights, pairs: torch.Tensor) -> torch.Tensor:
    """Logits [E, K, M] of standardised features [K, M, D] of pairs."""
    activation = torch.einsum("kmd,edh->ekmh", pairs, weights["w1"]) + weights["b1"][:, None, None]
    return torch.einsum("ekmh,eh->ekm", torch.relu(activation), weights["w2"]) + weights["b2"][:, None, None]


def _brief(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 80 else f"{text[:77]}… ({len(value)})"
