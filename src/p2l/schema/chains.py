"""Configurations of the stages that learn recoveries by RecoveryChaining (chapter 5) and judge them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from p2l.chaining.learners.table import LEARNERS
from p2l.schema.base import ChoiceConfig, ConfigSection, Count, NotNegative, Positive, Probability, StageConfig
from p2l.schema.recovery import VideoConfig, WorldStageConfig

Seed = Annotated[int, Field(ge=0)]
MIXED = "search_mixed"  # the search whose parameters name further worlds


class LearnerConfig(ChoiceConfig):
    """A learner.

    Attributes:
        budget_share: share of the stage's budget that it gets.
        evaluate_every: control steps between its evaluations, if not the stage's.
        ppo: settings of PPO that differ from the stage's.
    """

    registry = LEARNERS

    budget_share: Annotated[float, Field(gt=0, le=1)] = 1.0
    evaluate_every: Count | None = None
    ppo: dict[str, Any] = Field(default_factory=dict)

    @property
    def title(self) -> str:
        """What a run of it alone is called: a search in several worlds is another method than one in its own."""
        return MIXED if self.key == "search" and "mixture" in self.params else self.name

    @model_serializer(mode="wrap")
    def _without_what_is_absent(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A configuration is the same as before there were targets, or settings of PPO of its own."""
        values: dict[str, Any] = plain(self)
        absent = [key for key in ("target", "evaluate_every", "ppo") if not values[key]]
        return {key: values[key] for key in ("name", *values) if key not in absent}


class LimitsConfig(ConfigSection):
    """See `p2l.chaining.mdp.Limits`; no `fields` stands for the whole observation."""

    decisions: Count
    primitive_steps: Count
    history: Count
    fields: tuple[str, ...]


class OwnLimitsConfig(ConfigSection):
    """Of `LimitsConfig`, what differs for a learner."""

    decisions: Count | None = None
    primitive_steps: Count | None = None
    history: Count | None = None
    fields: tuple[str, ...] | None = None


class PPOConfig(ConfigSection):
    """See `p2l.chaining.ppo.PPOSettings`."""

    n_steps: Count
    batch_size: Annotated[int, Field(ge=2)]
    n_epochs: Count
    learning_rate: Positive
    clip_range: Positive
    ent_coef: NotNegative
    gamma: Probability
    gae_lambda: Probability
    hidden: Annotated[tuple[Count, ...], Field(min_length=1)]


class EvaluationConfig(ConfigSection):
    """Evaluations during training: `every` so many control steps, on failures set apart."""

    every: Count
    episodes: Count


class ChainRecoveriesConfig(WorldStageConfig):
    """Stage `chain_recoveries`: learn a recovery policy from recorded failures.

    Without `compare`, one run: `learner` with `seed`. With it, those of `learners`, each with every one of `seeds`;
    `records` holds finished ones of them. `limits_of` has limits that differ for a learner, by its name, or by the name
    of the learner that it is a variant of: it sees what suits it, in the same world.
    """

    failures: Path
    learner: LearnerConfig
    compare: tuple[str, ...]
    seeds: tuple[Seed, ...]
    learners: dict[str, LearnerConfig]
    records: Path | None
    limits: LimitsConfig
    limits_of: dict[str, OwnLimitsConfig]
    narrowest: Positive
    budget: Count
    slots: Count
    revisit: Probability
    evaluation: EvaluationConfig
    ppo: PPOConfig

    @property
    def method(self) -> str:
        """The learner, or all that are compared."""
        return "learners" if self.compare else self.learner.title

    def alone(self, learner: str | None = None, seed: int | None = None) -> ChainRecoveriesConfig:
        """One run without what does not concern it: `learner` with `seed` of those that are compared, or its own."""
        update: dict[str, Any] = {} if learner is None else {"learner": self.learners[learner], "seed": seed}
        names = (learner, self.learner.name if learner is None else self.learners[learner].name)
        limits = [self.limits_of[name] for name in names if name in self.limits_of]
        own = limits[0].model_dump(exclude_none=True) if limits else {}
        update |= {"limits": self.limits.model_copy(update=own), "limits_of": {}}
        return self.model_copy(update={**update, "compare": (), "seeds": (), "learners": {}, "records": None})

    def ppo_of(self, learner: LearnerConfig) -> PPOConfig:
        """Settings of PPO for a learner: the stage's, but for its own."""
        return PPOConfig.model_validate_json(json.dumps({**self.ppo.model_dump(mode="json"), **learner.ppo}))

    @model_validator(mode="after")
    def _limits_of_known_learners(self) -> ChainRecoveriesConfig:
        known = {*self.learners, *LEARNERS.names(), self.learner.name, *(each.name for each in self.learners.values())}
        if unknown := sorted(set(self.limits_of) - known):
            raise ValueError(
                f"limits_of: {', '.join(unknown)} is none of the learners; known: {', '.join(sorted(known))}"
            )
        return self

    @model_validator(mode="after")
    def _settings_of_ppo(self) -> ChainRecoveriesConfig:
        for place, learner in {
            "learner": self.learner,
            **{f"learners.{n}": v for n, v in self.learners.items()},
        }.items():
            if learner.name == "search" and (idle := sorted(set(learner.ppo) - {"hidden"})):
                raise ValueError(
                    f"{place}.ppo.{idle[0]}: the search takes no policy gradient; of ppo it heeds hidden only"
                )
            try:
                self.ppo_of(learner)
            except ValidationError as error:
                first = error.errors(include_url=False)[0]
                key = ".".join(str(part) for part in first["loc"])
                allowed = (
                    f"; its keys are {', '.join(PPOConfig.model_fields)}" if first["type"] == "extra_forbidden" else ""
                )
                raise ValueError(f"{place}.ppo.{key}: given {first['input']!r}; {first['msg']}{allowed}") from None
        return self

    @model_validator(mode="after")
    def _runs(self) -> ChainRecoveriesConfig:
        if unknown := sorted(set(self.compare) - set(self.learners)):
            raise ValueError(
                f"compare names {', '.join(unknown)}; learners has: {', '.join(self.learners) or 'none'}. Add one of a "
                f"YAML with +learner@learners.{unknown[0]}={unknown[0]}"
            )
        if self.compare and not self.seeds:
            raise ValueError("compare needs seeds: name at least one")
        if self.seeds and not self.compare:
            raise ValueError(
                f"seeds are those of compare, which names nothing; say compare=[{self.learner.title}], or seed="
                f"{self.seeds[0]} for one run"
            )
        for place, names in (("compare", self.compare), ("seeds", self.seeds)):
            if len(set(names)) < len(names):
                raise ValueError(f"{place} names something twice: {', '.join(map(str, names))}")
        return self


class TransferConfig(ConfigSection):
    """Table 5.2: policies, unchanged, in worlds that they were not learnt in.

    Attributes:
        learners: whose policies.
        failures: to induce for each policy and variant; none: the table is left out.
        robosuite_failures: to induce in robosuite's own environment, where there is one; one row at a time.
        variants: by name, the world's parameters that differ.
    """

    learners: tuple[str, ...]
    failures: Annotated[int, Field(ge=0)]
    robosuite_failures: Annotated[int, Field(ge=0)]
    variants: dict[str, dict[str, Any]]


class ReuseConfig(ConfigSection):
    """Figure 5.9, and recoveries by strategy.

    Attributes:
        learners: whose policies.
        nominal_runs: of the nominal skills, to know where they are.
    """

    learners: tuple[str, ...]
    nominal_runs: Count


class AblationConfig(ConfigSection):
    """Policies learnt under other state uncertainty, or from other observations: one folder for each variant.

    Attributes:
        learner: whose policies.
        variants: by name, the world's parameters that differ; the policies are those of `<learnt>_<name>`.
    """

    learner: str
    variants: dict[str, dict[str, Any]]


class CeilingConfig(ConfigSection):
    """What macros do without a policy.

    Attributes:
        learner: which searches for them.
        macros: how many of those that each of its runs has left; none: the rows are left out.
    """

    learner: str
    macros: Annotated[int, Field(ge=0)]


class EvaluateChainsConfig(WorldStageConfig):
    """Stage `evaluate_chains`: the whole robot on unseen start states.

    `learnt` is the folder of `chain_recoveries`: it holds policies/<learner>/s<seed>, rounds.csv and evaluations.csv.
    """

    learnt: Path
    thesis: Path
    records: Path | None
    learners: Annotated[tuple[str, ...], Field(min_length=1)]
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1)]
    episodes: Count
    slots: Count
    transfer: TransferConfig
    reuse: ReuseConfig
    ablation: AblationConfig
    ceiling: CeilingConfig
    videos: bool
    video: VideoConfig

    @model_validator(mode="after")
    def _names_of_learners(self) -> EvaluateChainsConfig:
        """A learner that is not evaluated is left out of a table, but a name that none has is a mistake."""
        known = [*dict.fromkeys([*self.learners, *LEARNERS.names(), MIXED])]
        of = {"transfer.learners": self.transfer.learners, "reuse.learners": self.reuse.learners}
        of |= {"ceiling.learner": (self.ceiling.learner,), "ablation.learner": (self.ablation.learner,)}
        for place, names in of.items():
            if unknown := [name for name in names if name not in known]:
                raise ValueError(
                    f"{place} names {', '.join(unknown)}, which is neither among `learners` nor one of ours; known: "
                    f"{', '.join(known)}"
                )
        return self

    @property
    def method(self) -> str:
        """All learners are compared."""
        return "learners"


class ExportConfig(StageConfig):
    """Stage `export`: a policy as ONNX; `failures: null` is where the pipeline has those of its world."""

    policy: Path
    failures: Path | None

    @property
    def subject(self) -> str:
        """The policy's folder."""
        return self.policy.name

    @property
    def method(self) -> str:
        """The only one."""
        return "onnx"
