"""Checkpoints from which an interrupted training run resumes."""

from __future__ import annotations

from collections.abc import Mapping
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


def refuse_others(folder: Path, wanted: Mapping[tuple[str, int], str]) -> None:
    """Refuse a folder whose policies a run would overwrite, or leave beside tables that do not tell of them.

    Args:
        folder: of a comparison, or of a single run.
        wanted: hash of the configuration of each run that is compared, by learner and seed; none of a single run.

    Raises:
        ArtifactError: it holds policies of other runs.
    """
    others = ["a single run"] if wanted and (folder / f"{POLICY}.json").is_file() else []
    for card in sorted(folder.glob(f"policies/*/s*/{POLICY}.json")):
        learner, seed = card.parts[-3:-1]
        hashes = {f"s{number}": config_hash for (name, number), config_hash in wanted.items() if name == learner}
        if hashes.get(seed) != load_policy(card.parent).card.config_hash:
            others.append(f"{learner} {seed}")
    if others:
        raise ArtifactError(
            f"{folder}: holds {', '.join(others)} of another comparison or configuration, which would be overwritten; "
            "choose another folder (hydra.run.dir=…), or delete it. Runs that are there are kept where compare and "
            "seeds name them, too, and nothing else of the configuration has changed"
        )


def drop_checkpoint(folder: Path) -> None:
    """Delete the checkpoint of a completed run."""
    for file in (folder / FILE, folder / f"{FILE}.json"):
        file.unlink(missing_ok=True)
