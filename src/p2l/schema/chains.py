"""Configurations of the stages that learn recoveries by RecoveryChaining (chapter 5) and judge them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from p2l.recoveries.chaining.learners import known_learners
from p2l.schema.base import Count, NotNegative, Positive, Probability, Section
from p2l.schema.recovery import WorldStageConfig


def known_learner(name: str) -> str:
    """Refuse a learner that is not registered."""
    if name not in known_learners():
        raise ValueError(f"unknown learner; allowed: {', '.join(known_learners())}")
    return name


Learner = Annotated[str, AfterValidator(known_learner)]


class LearnerConfig(Section):
    """A registered learner; `params` go to it, and it refuses those it does not know.

    `budget_share` is the share of the stage's budget that it may simulate: a lazy learner gets less.
    """

    name: Learner
    params: dict[str, Any] = Field(default_factory=dict)
    budget_share: Annotated[float, Field(gt=0, le=1)] = 1.0


class LimitsConfig(Section):
    """See `p2l.recoveries.chaining.mdp.Limits`; no `fields` stands for the whole observation."""

    decisions: Count
    primitive_steps: Count
    history: Count
    fields: tuple[str, ...]


class PPOConfig(Section):
    """See `p2l.recoveries.chaining.ppo.PPOSettings`."""

    n_steps: Count
    batch_size: Annotated[int, Field(ge=2)]
    n_epochs: Count
    learning_rate: Positive
    clip_range: Positive
    ent_coef: NotNegative
    gamma: Probability
    gae_lambda: Probability
    hidden: Annotated[tuple[Count, ...], Field(min_length=1)]


class EvaluationConfig(Section):
    """Evaluations during training: `every` so many control steps, on failures set apart."""

    every: Count
    episodes: Count


class ChainRecoveriesConfig(WorldStageConfig):
    """Stage `chain_recoveries`: learn a recovery policy from recorded failures."""

    failures: Path
    learner: LearnerConfig
    limits: LimitsConfig
    budget: Count
    slots: Count
    evaluation: EvaluationConfig
    ppo: PPOConfig

    @property
    def method(self) -> str:
        """The learner."""
        return self.learner.name


class EvaluateChainsConfig(WorldStageConfig):
    """Stage `evaluate_chains`: the whole robot on start states that nobody has seen.

    `policies` holds the runs of `chain_recoveries` as `<learner>/s<seed>`.
    """

    policies: Path
    learners: Annotated[tuple[Learner, ...], Field(min_length=1)]
    seeds: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)]
    episodes: Count
    slots: Count

    @property
    def method(self) -> str:
        """All learners are compared."""
        return "learners"
