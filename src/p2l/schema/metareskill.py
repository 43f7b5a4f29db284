"""Configurations of chapter 4's stages, and of its failure rounds, which are run by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from p2l.metareskill.choosers.table import CHOOSERS
from p2l.metareskill.strategy_names import STRATEGIES
from p2l.schema.base import ArchivedStageConfig, ChoiceConfig, ConfigSection, Count, Positive, Probability
from p2l.schema.recovery import ExecutionsConfig, SymbolicWorldConfig, VideoConfig, WorldStageConfig


def _check_strategy(name: str) -> str:
    """Refuse a strategy that does not exist."""
    if name not in STRATEGIES:
        raise ValueError(f"unknown strategy; allowed: {', '.join(STRATEGIES)}")
    return name


Strategy = Annotated[str, AfterValidator(_check_strategy)]
Share = Annotated[float, Field(gt=0, lt=1)]
Steps = Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=3, max_length=3)]
Seeds = Annotated[tuple[Annotated[int, Field(ge=0, lt=2**32)], ...], Field(min_length=1)]


class TimingConfig(ConfigSection):
    """See `p2l.skills.relative.Timing`."""

    legs: Steps
    settle: Steps


class VicinityConfig(ConfigSection):
    """See `p2l.preconditions.vicinity.Vicinity`."""

    noise: Positive
    spread: Positive
    moved: Probability
    arrival_m: Positive


class FitPreconditionsConfig(WorldStageConfig, ArchivedStageConfig):
    """Stage `fit_preconditions`: Algorithm 2; see `p2l.preconditions.backwards.ChainingOptions`."""

    world: SymbolicWorldConfig
    trajectories: Annotated[int, Field(ge=4)]
    samples: Annotated[int, Field(ge=8)]
    components: Count
    regularisation: Positive
    held_out: Share
    error: Annotated[float, Field(ge=0)]
    draws: Count
    vicinity: VicinityConfig
    timing: TimingConfig
    counts: tuple[Count, ...]

    @property
    def method(self) -> str:
        """The only one."""
        return "chaining"


class QueryConfig(ConfigSection):
    """One REPS query; see `p2l.metareskill.query.QueryOptions`."""

    updates: Count
    rollouts: Annotated[int, Field(ge=2)]
    hopeless: Count
    epsilon: Positive
    minimum_temperature: Positive
    solved: Annotated[float, Field(gt=0, le=1)]
    sigma_m: Annotated[tuple[Positive, ...], Field(min_length=3, max_length=3)]
    sigma_rad: Positive
    sigma_grip: Positive
    floor: Probability
    shrinkage: Probability
    all_updates: bool
    verify: bool


class ChooserConfig(ChoiceConfig):
    """A chooser; its factory refuses settings that it does not know."""

    registry = CHOOSERS


class RewardsConfig(ConfigSection):
    """Of the skill graph; see `p2l.metareskill.graph`."""

    skill_reward: Annotated[float, Field(le=0)]
    recovery_reward: Annotated[float, Field(le=0)]
    c_fail: Positive


class RecoveryFilesConfig(WorldStageConfig):
    """A stage that works on failures, their modes and the preconditions."""

    world: SymbolicWorldConfig
    preconditions: Path
    modes: Path


class LearnRecoveriesConfig(RecoveryFilesConfig):
    """Stage `learn_recoveries`: which recovery to train next, by each of `compare` (names in `choosers`).

    The first one's skills are kept. `seeds` are of training, drawn apart from the stage's own. `records` is where
    ledgers and histories are kept so that another machine goes on from them; null keeps them beside the results.
    `reported` executions find the failures that values are reported of, which neither training nor choosing meets.
    """

    failures: Path
    held_out: Path
    records: Path | None = None
    choosers: Annotated[dict[str, ChooserConfig], Field(min_length=1)]
    compare: Annotated[tuple[str, ...], Field(min_length=1)]
    seeds: Seeds
    rounds: Count
    episodes: Count
    trials: Count
    reported: Annotated[int, Field(ge=0)]
    guesses: tuple[Literal["straight", "take", "carry"], ...]
    rewards: RewardsConfig
    query: QueryConfig
    timing: TimingConfig
    videos: bool
    video: VideoConfig

    @property
    def method(self) -> str:
        """The chooser whose skills are kept."""
        return self.compare[0]

    @model_validator(mode="after")
    def _check_names(self) -> LearnRecoveriesConfig:
        if unknown := sorted(set(self.compare) - set(self.choosers)):
            raise ValueError(f"compare names {', '.join(unknown)}; choosers has: {', '.join(self.choosers)}")
        if len(set(self.compare)) < len(self.compare) or len(set(self.seeds)) < len(self.seeds):
            raise ValueError("compare or seeds names something twice")
        return self


class IterateRecoveriesConfig(LearnRecoveriesConfig):
    """Stage `iterate_recoveries`: `failure_rounds` of learning, each on what the one before it left unsolved.

    `executions` are run with the recoveries in place to find new failures, and `development` episodes to see success.
    """

    failure_rounds: Count
    executions: ExecutionsConfig
    max_modes: Count
    development: Count
    max_options: Count
    slots: Count


class EvaluateRecoveriesConfig(RecoveryFilesConfig):
    """Stage `evaluate_recoveries`: tables 4.1 and 4.2, figures 4.6 and 4.7.

    `learnt` is the folder of `learn_recoveries`. `handles` are doors of table 4.2, the first one that of training;
    `robosuite_episodes` are run for each seed of `robosuite_seeds`, one row at a time, and none where there is no seed.
    """

    learnt: Path
    thesis: Path
    records: Path | None
    seeds: Seeds
    strategies: Annotated[tuple[Strategy, ...], Field(min_length=1)]
    episodes: Count
    handles: tuple[str, ...]
    handle_episodes: Count
    robosuite_seeds: tuple[Annotated[int, Field(ge=0, lt=2**32)], ...]
    robosuite_episodes: Count
    max_options: Count
    slots: Count

    @property
    def method(self) -> str:
        """All strategies are compared."""
        return "strategies"

    @model_validator(mode="after")
    def _check_names(self) -> EvaluateRecoveriesConfig:
        if unknown := sorted(set(self.robosuite_seeds) - set(self.seeds)):
            raise ValueError(f"robosuite_seeds names {unknown}, which are not among seeds")
        for name in ("seeds", "strategies", "handles", "robosuite_seeds"):
            if len(set(getattr(self, name))) < len(getattr(self, name)):
                raise ValueError(f"{name} names something twice")
        return self
