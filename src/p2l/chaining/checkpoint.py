"""Where a killed run of learning goes on."""

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
SUMMARY = "summary.json"  # what a run leaves last


@dataclass
class Progress:
    """How far a run has come.

    Attributes:
        control_steps: simulated for learning.
        seconds: that took, evaluations included.
        evaluation_seconds: of these, spent in evaluations.
        best: success of the best evaluation.
        rounds: one row per rollout.
        evaluations: one row per evaluation.
        tensors: weights and the optimiser's state.
    """

    control_steps: int = 0
    seconds: float = 0.0
    evaluation_seconds: float = 0.0
    best: float = -1.0
    rounds: list[dict[str, Any]] = field(default_factory=list)
    evaluations: list[dict[str, Any]] = field(default_factory=list)
    tensors: dict[str, torch.Tensor] = field(default_factory=dict)


def save_checkpoint(folder: Path, progress: Progress, card: Card) -> None:
    """Replace the checkpoint in `folder`."""
    told = {field.name: getattr(progress, field.name) for field in fields(progress) if field.name != "tensors"}
    save_network(folder / FILE, progress.tensors, {"config_hash": card.config_hash, **told}, schema=SCHEMA)


def load_checkpoint(folder: Path, card: Card) -> Progress | None:
    """The checkpoint in `folder`, or None if there is none.

    Raises:
        ArtifactError: damaged, or left by another configuration.
    """
    if not (folder / FILE).is_file():
        return None
    tensors, told = load_network(folder / FILE, schema=SCHEMA)
    if told.pop("config_hash") != card.config_hash:
        raise ArtifactError(
            f"{folder / FILE}: left by a run with another configuration; delete it to start over, or choose another "
            "folder (hydra.run.dir=…)"
        )
    return Progress(**told, tensors=tensors)


def finished(folder: Path, config_hash: str) -> bool:
    """Whether a run of this configuration has left its policy, and no checkpoint to go on from, in `folder`.

    Raises:
        ArtifactError: a run of another configuration has, whose policy would be lost.
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
    """A finished run needs none."""
    for file in (folder / FILE, folder / f"{FILE}.json"):
        file.unlink(missing_ok=True)
