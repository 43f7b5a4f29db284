"""Fit the precondition prediction model: split by task, train all members at once, stop early, correct.

A pair enters the fit only if both of its tasks do. Each of the E members leaves out one fold of the fitted tasks; its
loss on pairs that are tested on that fold stops it, and the pooled out-of-fold logits fit Platt's correction. The same
loss chooses the weight decay (`fit_best`), so that no choice is made on the tasks that scores are reported of.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch.nn import functional

from p2l.contracts.domain import Encoding
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray, TransferData
from p2l.transfer.calibration import Platt, fit_platt
from p2l.transfer.encodings import PAIRS, is_linear, width
from p2l.transfer.model import TransferModel, Weights, network_logits, pair_logits

Report = Callable[[int, float, float], None]  # epoch, mean training loss, mean validation loss


@dataclass(frozen=True)
class FitOptions:
    """How to fit; `members` is also the number of folds, `patience` is in epochs."""

    hidden: int = 64
    epochs: int = 300
    learning_rate: float = 1e-2
    weight_decay: float = 0.3
    batch_size: int = 512
    members: int = 5
    patience: int = 25
    calibrate: bool = True


@dataclass(frozen=True)
class TaskSplit:
    """`fold` [M]: the member that leaves a task out, or -1 for a task that is held out of the whole fit."""

    fold: IntArray

    @property
    def held_out(self) -> BoolArray:
        """[M] tasks that nothing was fitted to."""
        return self.fold < 0


@dataclass(frozen=True)
class Fit:
    """A model and how it came about; losses are [epochs, E] in nats per execution."""

    model: TransferModel
    training_loss: Array
    validation_loss: Array
    best_epoch: IntArray

    @property
    def loss(self) -> float:
        """Mean over members of the smallest loss on the fold that each leaves out, nats per execution."""
        return float(self.validation_loss.min(axis=0).mean())


@dataclass(frozen=True)
class _Tensors:
    """Data as the networks take it: rate [K, M], train_task [K] task numbers, fold [M], all standardised.

    `features` are [M, F] of tasks for a linear encoding, else [K, M, D] of pairs.
    """

    encoding: Encoding
    features: torch.Tensor
    rate: torch.Tensor
    train_task: torch.Tensor
    fold: torch.Tensor

    def inputs(self, skill: torch.Tensor, task: torch.Tensor) -> torch.Tensor:
        """[E, B, D] what the networks see of the pairs of skills [E, B] and tasks [E, B]."""
        if not is_linear(self.encoding):
            return self.features[skill, task]
        first, second = self.features[self.train_task[skill]], self.features[task]
        return first - second if self.encoding == "difference" else torch.cat([first, second], dim=2)

    def logits(self, weights: Weights, rows: torch.Tensor, columns: torch.Tensor) -> torch.Tensor:
        """[E, K, M] of the pairs of all skills `rows` [K] with all tasks `columns` [M]."""
        if not is_linear(self.encoding):
            return network_logits(weights, self.features[rows][:, columns])
        return pair_logits(weights, self.encoding, self.features[self.train_task[rows]], self.features[columns])


def split_tasks(data: TransferData, holdout: float, members: int, rng: np.random.Generator) -> TaskSplit:
    """Hold out a share of the tasks and deal the others to folds, evenly over groups and over taught tasks.

    Tasks with equal features are one task here: a held-out task is in no fold, not even as a twin.

    Raises:
        ConfigError: too few tasks or taught tasks to fit and to judge.
    """
    _, first, twin = np.unique(np.round(data.features, 6), axis=0, return_index=True, return_inverse=True)
    m = len(first)
    count = max(1, round(holdout * m))
    has_skill = np.isin(np.arange(m), twin[data.train_task])
    if m - count < members or members < 2 or has_skill.sum() < 3:
        raise ConfigError(
            f"{m} distinct tasks, {int(has_skill.sum())} of them taught, holdout {holdout} and {members} members: "
            "needs at least 3 taught tasks, 2 members, and as many tasks not held out as members. Collect more tasks."
        )
    # Every m / count-th task of this order is held out, so that each group and the taught ones lose their share.
    order = np.lexsort((rng.random(m), data.group[first], ~has_skill))
    place = (np.arange(m) + rng.integers(m)) % m
    held_out = (place * count) % m < count
    fold = np.full(m, -1, dtype=np.int64)
    fold[order[~held_out]] = (np.arange(m - int(held_out.sum())) + rng.integers(members)) % members
    return TaskSplit(fold[twin])


def fit(
    data: TransferData,
    encoding: Encoding,
    split: TaskSplit,
    options: FitOptions,
    generator: torch.Generator,
    report: Report | None = None,
) -> Fit:
    """Fit the ensemble to the tasks that `split` does not hold out."""
    seen = ~split.held_out
    if is_linear(encoding):
        features, fitted = data.features, data.features[seen]
    else:
        features = PAIRS[encoding](data.feature_names, data.features[data.train_task], data.features)
        fitted = features[seen[data.train_task]][:, seen].reshape(-1, features.shape[2])
    mean, scale = _moments(fitted)
    tensors = _Tensors(
        encoding,
        torch.tensor((features - mean) / scale, dtype=torch.float32),
        torch.tensor(data.rate, dtype=torch.float32),
        torch.tensor(data.train_task),
        torch.tensor(split.fold),
    )
    weights = _initial(data.features.shape[1], encoding, options, generator)
    best, training, validation, best_epoch = _train(weights, tensors, options, generator, report)
    platt = Platt()
    if options.calibrate:
        platt = _correction(TransferModel(encoding, data.feature_names, mean, scale, best, platt), data, split)
    model = TransferModel(encoding, data.feature_names, mean, scale, best, platt)
    return Fit(model, training, validation, best_epoch)


def fit_best(
    data: TransferData,
    encoding: Encoding,
    split: TaskSplit,
    options: FitOptions,
    decays: Sequence[float],
    seed: int,
    report: Callable[[float], Report] | None = None,
) -> tuple[Fit, dict[float, float]]:
    """The fit with the weight decay of the smallest `Fit.loss`, and that loss by weight decay; the first wins ties.

    Args:
        data: what was collected.
        encoding: how a pair of tasks enters.
        split: see `split_tasks`.
        options: of every fit, but for its weight decay.
        decays: to choose from, at least one.
        seed: of every fit's generator, so that they start from the same weights.
        report: makes the `report` of the fit with a weight decay.

    Raises:
        ConfigError: no weight decay to choose from, or see `fit`.
    """
    if not decays:
        raise ConfigError("weight decay: none given to choose from")
    fits = {}
    for decay in decays:
        tell = None if report is None else report(decay)
        each = replace(options, weight_decay=decay)
        fits[decay] = fit(data, encoding, split, each, torch.Generator().manual_seed(seed), tell)
    losses = {decay: one.loss for decay, one in fits.items()}
    return fits[min(losses, key=losses.__getitem__)], losses


def _moments(features: Array) -> tuple[Array, Array]:
    """Mean and scale [F]; a feature that never varies keeps its unit."""
    scale = features.std(axis=0)
    return features.mean(axis=0), np.where(scale > 1e-9, scale, 1.0)


def _initial(
    features: int, encoding: Encoding, options: FitOptions, generator: torch.Generator
) -> dict[str, torch.Tensor]:
    """He's initialisation, drawn from `generator`."""
    e, h, d = options.members, options.hidden, width(encoding, features)
    weights = {
        "w1": torch.randn(e, d, h, generator=generator) * (2.0 / d) ** 0.5,
        "b1": torch.zeros(e, h),
        "w2": torch.randn(e, h, generator=generator) * (1.0 / h) ** 0.5,
        "b2": torch.zeros(e),
    }
    return {name: value.requires_grad_() for name, value in weights.items()}


def _train(
    weights: dict[str, torch.Tensor],
    tensors: _Tensors,
    options: FitOptions,
    generator: torch.Generator,
    report: Report | None,
) -> tuple[Weights, Array, Array, IntArray]:
    """Each member's weights at its best epoch, both losses [epochs, E], and that epoch [E]."""
    pairs = [_pairs(tensors, member) for member in range(options.members)]
    kernels, biases = [weights["w1"], weights["w2"]], [weights["b1"], weights["b2"]]
    optimizer = torch.optim.AdamW(
        [{"params": kernels, "weight_decay": options.weight_decay}, {"params": biases, "weight_decay": 0.0}],
        lr=options.learning_rate,
    )
    best = {name: value.detach().clone() for name, value in weights.items()}
    best_loss = torch.full((options.members,), float("inf"))
    best_epoch = torch.zeros(options.members, dtype=torch.int64)
    history: list[tuple[torch.Tensor, torch.Tensor]] = []
    for epoch in range(options.epochs):
        history.append((_epoch(weights, tensors, pairs, options, optimizer, generator), _validation(weights, tensors)))
        training, validation = history[-1]
        better = validation < best_loss
        best_loss, best_epoch[better] = torch.minimum(validation, best_loss), epoch
        for name, value in weights.items():
            best[name][better] = value.detach()[better]
        if report is not None:
            report(epoch, float(training.mean()), float(validation.mean()))
        if epoch - int(best_epoch.max()) >= options.patience:
            break
    losses = [torch.stack(column).numpy().astype(np.float64) for column in zip(*history, strict=True)]
    return best, losses[0], losses[1], best_epoch.numpy()


def _pairs(tensors: _Tensors, member: int) -> torch.Tensor:
    """[2, N] skill and task numbers of every pair that `member` is fitted to: both of its tasks are in other folds."""
    inside = (tensors.fold >= 0) & (tensors.fold != member)
    pairs = torch.cartesian_prod(torch.nonzero(inside[tensors.train_task])[:, 0], torch.nonzero(inside)[:, 0]).T
    if pairs.shape[1] == 0:
        raise ConfigError(f"fold {member} leaves no taught task to fit; teach more tasks or use fewer members")
    return pairs


def _epoch(
    weights: Weights,
    tensors: _Tensors,
    pairs: list[torch.Tensor],
    options: FitOptions,
    optimizer: torch.optim.Optimizer,
    generator: torch.Generator,
) -> torch.Tensor:
    """One pass over the pairs, all members side by side; returns the mean loss [E]. Shorter members wrap around."""
    longest = max(one.shape[1] for one in pairs)
    turn = torch.arange(longest)
    shuffles = [one[:, torch.randperm(one.shape[1], generator=generator)[turn % one.shape[1]]] for one in pairs]
    total = torch.zeros(len(pairs))
    for batch in torch.stack(shuffles).split(options.batch_size, dim=2):  # [E, 2, B]
        skill, task = batch[:, 0], batch[:, 1]
        x = tensors.inputs(skill, task)
        activation = torch.relu(torch.baddbmm(weights["b1"][:, None], x, weights["w1"]))
        logit = torch.einsum("ebh,eh->eb", activation, weights["w2"]) + weights["b2"][:, None]
        target = tensors.rate[skill, task]
        loss = functional.binary_cross_entropy_with_logits(logit, target, reduction="none").mean(dim=1)
        optimizer.zero_grad()
        loss.sum().backward()
        optimizer.step()
        total += loss.detach() * batch.shape[2]
    return total / longest


def _validation(weights: Weights, tensors: _Tensors) -> torch.Tensor:
    """Loss [E] of each member on pairs that are tested on its own fold."""
    rows = torch.nonzero(tensors.fold[tensors.train_task] >= 0)[:, 0]
    losses = []
    for e in range(len(weights["b2"])):
        columns = torch.nonzero(tensors.fold == e)[:, 0]
        member = {name: value.detach()[e : e + 1] for name, value in weights.items()}
        logit = tensors.logits(member, rows, columns)[0]
        losses.append(functional.binary_cross_entropy_with_logits(logit, tensors.rate[rows][:, columns]))
    return torch.stack(losses)


def _correction(model: TransferModel, data: TransferData, split: TaskSplit) -> Platt:
    """Platt's correction of logits that a member gave to its own fold."""
    rows = np.flatnonzero(split.fold[data.train_task] >= 0)
    columns = np.flatnonzero(split.fold >= 0)
    logits = model.logits(data.features[data.train_task[rows]], data.features[columns])
    own = np.take_along_axis(logits, split.fold[columns][None, None], axis=0)[0]
    return fit_platt(own.ravel(), data.successes[np.ix_(rows, columns)].ravel(), data.draws)
