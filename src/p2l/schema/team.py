"""Configurations of the team's stages (chapter 3): `collect`, `fit_transfer`, `plan`, `evaluate_team`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from p2l.artifacts import config_hash
from p2l.domains.table import DOMAINS
from p2l.errors import ConfigError
from p2l.schema.base import (
    ArchivedStageConfig,
    ChoiceConfig,
    ConfigSection,
    Count,
    NotNegative,
    Positive,
    Probability,
    StageConfig,
)
from p2l.schema.tomorrow import FutureConfig, FutureFiles
from p2l.team.study import Regime, Study


class CostsConfig(ConfigSection):
    """The four costs of the thesis (section 3.3.1), in any one unit of effort."""

    c_rob: NotNegative
    c_hum: NotNegative
    c_fail: NotNegative
    c_demo: NotNegative


class DomainConfig(ChoiceConfig):
    """A task distribution."""

    registry = DOMAINS


class DomainStageConfig(StageConfig):
    """Configuration of a stage that works on one domain.

    How a predictor sees pairs of tasks changes neither tasks nor skills; `fit_transfer`, which it matters to, says so.
    """

    idle: ClassVar[dict[str, Any]] = StageConfig.idle | {"domain": {"params": {"encoding"}}}

    domain: DomainConfig

    @property
    def subject(self) -> str:
        """The domain's name."""
        return self.domain.name


class RegimeConfig(CostsConfig):
    """Costs that all tasks share, and the numbers of pre-trained skills at which they are studied."""

    levels: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)]


class StudyConfig(ConfigSection):
    """An experiment of chapter 3; see `p2l.team.study.Study` for the meaning of each field."""

    set_size: Count
    sets: Count
    blocks: Count
    pool: Count
    pretrained_pool: Annotated[int, Field(ge=0)]
    draws: Count
    tuning_sets: Count
    theta: Probability
    orders: tuple[tuple[str, ...], ...]
    pretrained_draws: Annotated[int, Field(ge=0)] = 0
    regimes: Annotated[dict[str, RegimeConfig], Field(min_length=1)]

    @model_validator(mode="after")
    def _possible(self) -> StudyConfig:
        try:
            self.study()
        except ConfigError as error:
            raise ValueError(str(error)) from None
        return self

    def study(self) -> Study:
        """The frozen record that the planner's room works with."""
        plain = self.model_dump(exclude={"regimes"})
        regimes = tuple(Regime(name=name, **regime.model_dump()) for name, regime in self.regimes.items())
        return Study(regimes=regimes, **plain)


class StudyStageConfig(DomainStageConfig):
    """Configuration of a stage that works on the sets of a study."""

    study: StudyConfig

    @property
    def identity(self) -> str:
        """Hash of what decides a block's truth besides its tasks: world, learner and draws, whatever runs them."""
        world = {key: value for key, value in self.domain.params.items() if key not in ("nthread", "encoding")}
        return config_hash([self.domain.key, world, self.seed, self.study.draws])


class ArchivedDomainConfig(DomainStageConfig, ArchivedStageConfig):
    """Configuration of a stage that works on one domain and whose files are kept."""

    idle: ClassVar[dict[str, Any]] = DomainStageConfig.idle | ArchivedStageConfig.idle


class CollectConfig(ArchivedDomainConfig):
    """Stage `collect` (Algorithm 1): tasks, skills learnt on some of them, and every skill tried on every task."""

    n_tasks: Count
    n_taught: Count
    draws: Count

    @property
    def method(self) -> str:
        """The only one."""
        return "algorithm1"

    @model_validator(mode="after")
    def _taught_are_tasks(self) -> CollectConfig:
        if self.n_taught > self.n_tasks:
            raise ValueError(f"n_taught = {self.n_taught} exceeds n_tasks = {self.n_tasks}")
        return self


class FitTransferConfig(ArchivedDomainConfig):
    """Stage `fit_transfer`: the network that predicts how well the skill of one task does on another."""

    transfer_data: Path
    hidden: Count
    epochs: Count
    learning_rate: Positive
    weight_decay: Annotated[tuple[NotNegative, ...], Field(min_length=1)]
    batch_size: Count
    members: Annotated[int, Field(ge=2)]
    patience: Count
    holdout: Annotated[float, Field(gt=0, lt=1)]
    calibrate: bool

    @property
    def method(self) -> str:
        """The predictor."""
        return "mlp"


class ShopFiles(ConfigSection):
    """Files of a person's own tasks besides orders and transfer, and what fills the pairs that these leave open."""

    before: Path | None = None
    robots: Path | None = None
    fill: Probability | None = None
    features: Path | None = None
    trials: Path | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """Those that are given."""
        return tuple(path for path in (self.before, self.robots, self.features, self.trials) if path is not None)


class PlanConfig(StudyStageConfig, ShopFiles, FutureConfig):
    """Stage `plan`: a person's own tasks (`tasks` and `transfer` given), else sets drawn from the domain.

    Planners: see `p2l.team.PLANNERS`; the stage refuses an unknown one. `theta` is the confidence of CBA. `order` is
    fixed if none is given, partial where there is a `before`.
    """

    tasks: Path | None
    transfer: Path | None
    transfer_model: Path
    transfer_data: Path
    records: Path | None
    planner: str
    order: Literal["fixed", "any"] | None = None
    max_lessons: Annotated[int, Field(ge=0, le=1_000_000)] | None = None
    max_teaching: NotNegative | None = None
    reasons_s: NotNegative = 10.0
    time_limit_s: Positive
    gap: NotNegative
    theta: Probability

    @model_validator(mode="after")
    def _both_files(self) -> PlanConfig:
        if (self.tasks is None) != (self.transfer is None):
            missing = "transfer" if self.transfer is None else "tasks"
            raise ValueError(f"{missing} is missing; give tasks=<orders.csv> and transfer=<transfer.csv> together")
        if self.before is not None and self.order is not None:
            raise ValueError(f"order={self.order} and before=…: a partial order is an order of its own; leave one out")
        own = ("order", "max_lessons", "max_teaching", "before", "robots", "fill", "features", "trials", "scenarios",
               "forecast", "tomorrow")  # fmt: skip
        if self.has_future and self.planner != "auto":
            raise ValueError(f"planner={self.planner}: plans today only; an uncertain tomorrow has planner=auto")
        changes = {"planner": self.planner != "auto", "gap": self.gap != 0.0}
        changes |= {name: getattr(self, name) not in (None, "fixed") for name in own}
        if self.tasks is None and any(changes.values()):
            names = ", ".join(name for name, change in changes.items() if change)
            raise ValueError(f"{names}: only for your own tasks (tasks=… transfer=…); a study compares all planners")
        return self

    @property
    def subject(self) -> str:
        """The domain, or the name of the person's file."""
        return self.domain.name if self.tasks is None else self.tasks.stem

    @property
    def method(self) -> str:
        """The planner."""
        return self.planner


class CheckPlanConfig(StageConfig, ShopFiles, FutureFiles):
    """Stage `check_plan`: the plan in a folder against the tasks that it was made for."""

    tasks: Path
    transfer: Path
    plan: Path
    reasons_s: NotNegative = 10.0

    @property
    def subject(self) -> str:
        """The name of the person's file."""
        return self.tasks.stem

    @property
    def method(self) -> str:
        """The only one."""
        return "certificate"


class EvaluateTeamConfig(StudyStageConfig):
    """Stage `evaluate_team`: plans run in the world they were made for."""

    plans: Path
    records: Path | None
    time_limit_s: Positive

    @property
    def method(self) -> str:
        """All planners are compared."""
        return "planners"
