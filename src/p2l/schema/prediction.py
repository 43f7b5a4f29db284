"""Configuration of `predict_transfer`: from features and a few trials to a transfer table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from p2l.schema.base import ConfigSection, Positive, StageConfig

ModelName = Literal["rates", "logistic", "gp", "trees", "net"]
OpenProbability = Annotated[float, Field(gt=0, lt=1)]


class PriorConfig(ConfigSection):
    """What is believed of a pair before any trial; see `p2l.transfer.few_trials.Prior`."""

    same_task: OpenProbability
    same_family: OpenProbability
    other: OpenProbability
    pseudo_count: Positive


class PredictTransferConfig(StageConfig):
    """Stage `predict_transfer`: a person's tasks, what was tried, and optionally the orders that a plan is for."""

    features: Path
    trials: Path | None
    orders: Path | None
    out: Path | None
    format: Literal["long", "square"]
    order: Literal["fixed", "any"]
    level: OpenProbability
    prior: PriorConfig
    models: Annotated[tuple[ModelName, ...], Field(min_length=1)]
    folds: Annotated[int, Field(ge=2, le=1000)]
    fewest_pairs: Annotated[int, Field(ge=1, le=1_000_000)]
    members: Annotated[int, Field(ge=5, le=1000)]
    attempts_each: Annotated[int, Field(ge=1, le=5)]
    next_trials: Annotated[int, Field(ge=1, le=10_000)]

    @model_validator(mode="after")
    def _sizes_in_order(self) -> PredictTransferConfig:
        prior = self.prior
        if not prior.other <= prior.same_family <= prior.same_task:
            raise ValueError(
                f"prior: other = {prior.other}, same_family = {prior.same_family}, same_task = {prior.same_task}; "
                "the more alike two tasks are, the likelier a lesson helps"
            )
        return self

    @property
    def subject(self) -> str:
        """The name of the person's file."""
        return self.features.stem

    @property
    def method(self) -> str:
        """Models are compared."""
        return "few_trials"
