"""Checkpoints from which an interrupted training run resumes."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import torch

from p2l.artifacts import load_network, save_network
from p2l.chaining.policy import FILE as POLICY
from p2l.chaining.policy import Card, load_policy
from p2l.errors import ArtifactError

SCHEMA = "chain_checkpoint"
FILE = "checkpoint.safetensors"
SUMMARY = "summary.json"  # the last file that a run writes


@dataclass
class Progress:
    """State of a training run.

    Attributes:
        control_steps: simulated in training.
        spared: that the budget was charged for besides, see `ppo`.
        seconds: wall time, evaluations included.
        evaluation_seconds: wall time of the evaluations alone.
        best: success rate of the best evaluation.
        rounds: one row per rollout.
        evaluations: one row per evaluation.
        tensors: weights and the optimiser's state.
        told: numbers for the reader of the run's summary, of what was done besides.
    """

    control_steps: int = 0
    spared: int = 0
    seconds: float = 0.0
    evaluation_seconds: float = 0.0
    best: float = -1.0
    rounds: list[dict[str, Any]] = field(default_factory=list)
    evaluations: list[dict[str, Any]] = field(default_factory=list)
    tensors: dict[str, torch.Tensor] = field(default_factory=dict)
    told: dict[str, float] = field(default_factory=dict)


def save_checkpoint(folder: Path, progress: Progress, card: Card) -> None:
    """Replace the checkpoint in `folder`."""
    metadata = {field.name: getattr(progress, field.name) for field in fields(progress) if field.name != "tensors"}
    save_network(folder / FILE, progress.tensors, {"config_hash": card.config_hash, **metadata}, schema=SCHEMA)


def load_checkpoint(folder: Path, card: Card) -> Progress | None:
    """The checkpoint in `folder`, or None if there is none.

    Raises:
        ArtifactError: damaged, something else, or written by another configuration.
    """
    if not (folder / FILE).is_file():
        return None
    try:
        tensors, metadata = load_network(folder / FILE, schema=SCHEMA)
    except ArtifactError as error:
        raise ArtifactError(
            f"{folder / FILE}: damaged, or of something else; delete it and {FILE}.json to start this run over, "
            "put back a copy, or choose another folder (hydra.run.dir=…)"
        ) from error
    if metadata.pop("config_hash") != card.config_hash:
        raise ArtifactError(
            f"{folder / FILE}: left by a run with another configuration; delete it, {FILE}.json and the policy beside "
            "it to start over, or choose another folder (hydra.run.dir=…)"
        )
    return Progress(**metadata, tensors=tensors)


def is_finished(folder: Path, config_hash: str) -> bool:
    """Whether `folder` holds the policy of a completed run of this configuration, and no checkpoint.

    Raises:
        ArtifactError: it holds the policy of another configuration, which a new run would overwrite.
    """
    card, checkpoint = folder / f"{POLICY}.json", folder / FILE
    if not card.is_file() or checkpoint.is_file():
        return False
    if load_policy(folder).card.config_hash != config_hash:
        raise ArtifactError(
            f"{folder}: holds the policy of a run with another configuration; delete it, or choose another folder "
            "(hydra.run.dir=…)"
        )
    return (folder / SUMMARY).is_file()


def drop_checkpoint(folder: Path) -> None:
    """Delete the checkpoint of a completed run."""
    for file in (folder / FILE, folder / f"{FILE}.json"):
        file.unlink(missing_ok=True)
