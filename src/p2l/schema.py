"""What each stage's configuration may hold: types, ranges, and one message that names every wrong key.

Hydra composes, this validates: unknown keys are refused and every number has a range. One model per stage; a value is
read by the stage of the same name, so a field lives where it is used. `resolve` turns a composed Hydra configuration
into plain data, `validate` turns plain data into a frozen model.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, cast

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from p2l.artifacts import config_hash
from p2l.errors import ConfigError
from p2l.registry import known_domains
from p2l.team.study import Regime, Study

Count = Annotated[int, Field(ge=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Probability = Annotated[float, Field(ge=0, le=1)]
ModelT = TypeVar("ModelT", bound=BaseModel)


def _known(name: str) -> str:
    if name not in known_domains():
        raise ValueError(f"unknown domain; allowed: {', '.join(known_domains())}")
    return name


def _known_domains(names: tuple[str, ...]) -> tuple[str, ...]:
    if not names or len(set(names)) < len(names):
        raise ValueError("name at least one domain, and none twice")
    return tuple(_known(name) for name in names)


class Section(BaseModel):
    """Part of a configuration: frozen, no unknown keys, no NaN or infinity, no number written as text."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class TrackingConfig(Section):
    """Where metrics go; `uri: null` means `MLFLOW_TRACKING_URI`, else the repository's own sqlite store."""

    enabled: bool = True
    uri: str | None = None


class CostsConfig(Section):
    """The four costs of the thesis (section 3.3.1), in any one unit of effort."""

    c_rob: NotNegative
    c_hum: NotNegative
    c_fail: NotNegative
    c_demo: NotNegative


class DomainConfig(Section):
    """A registered task distribution; `params` go to its constructor, which refuses those it does not know."""

    name: Annotated[str, AfterValidator(_known)]
    params: dict[str, Any] = Field(default_factory=dict)


class StageConfig(Section):
    """What every stage's configuration holds."""

    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    tracking: TrackingConfig = TrackingConfig()

    @property
    def hash(self) -> str:
        """Identifies the work: hash of everything but `tracking`. Checkpoints carry it in their names."""
        return config_hash(self.model_dump(mode="json", exclude={"tracking"}))

    @property
    def world(self) -> str:
        """The world's name in run names and tags."""
        return "all"

    @property
    def method(self) -> str:
        """The method's name in run names and tags."""
        return "all"


class DomainStageConfig(StageConfig):
    """Configuration of a stage that works on one domain."""

    domain: DomainConfig

    @property
    def world(self) -> str:
        """The domain's name."""
        return self.domain.name


class RegimeConfig(CostsConfig):
    """Costs that all tasks share, and the numbers of pre-trained skills at which they are studied."""

    levels: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)]


class StudyConfig(Section):
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
        world = {key: value for key, value in self.domain.params.items() if key != "nthread"}
        return config_hash([self.domain.name, world, self.seed, self.study.draws])


class CollectConfig(DomainStageConfig):
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


class FitTransferConfig(DomainStageConfig):
    """Stage `fit_transfer`: the network that predicts how well the skill of one task does on another."""

    transfer_data: Path
    hidden: Count
    epochs: Count
    learning_rate: Positive
    weight_decay: NotNegative
    batch_size: Count
    members: Annotated[int, Field(ge=2)]
    patience: Count
    holdout: Annotated[float, Field(gt=0, lt=1)]
    calibrate: bool

    @property
    def method(self) -> str:
        """The predictor."""
        return "mlp"


class PlanConfig(StudyStageConfig):
    """Stage `plan`: a person's own tasks (`tasks` and `transfer` given), else sets drawn from the domain.

    Planners: see `p2l.team.PLANNERS`; the stage refuses an unknown one. `theta` is the confidence of CBA.
    """

    tasks: Path | None
    transfer: Path | None
    transfer_model: Path
    transfer_data: Path
    planner: str
    order: Literal["fixed", "any"]
    time_limit_s: Positive
    gap: NotNegative
    theta: Probability

    @model_validator(mode="after")
    def _both_files(self) -> PlanConfig:
        if (self.tasks is None) != (self.transfer is None):
            missing = "transfer" if self.transfer is None else "tasks"
            raise ValueError(f"{missing} is missing; give tasks=<orders.csv> and transfer=<transfer.csv> together")
        given = {"planner": self.planner != "auto", "order": self.order != "fixed", "gap": self.gap != 0.0}
        if self.tasks is None and any(given.values()):
            names = ", ".join(name for name, changed in given.items() if changed)
            raise ValueError(f"{names}: only for your own tasks (tasks=… transfer=…); a study compares all planners")
        return self

    @property
    def world(self) -> str:
        """The domain, or the name of the person's file."""
        return self.domain.name if self.tasks is None else self.tasks.stem

    @property
    def method(self) -> str:
        """The planner."""
        return self.planner


class EvaluateTeamConfig(StudyStageConfig):
    """Stage `evaluate_team`: plans run in the world they were made for."""

    plans: Path
    records: Path | None
    time_limit_s: Positive

    @property
    def method(self) -> str:
        """All planners are compared."""
        return "planners"


class ReportConfig(StageConfig):
    """Stage `report`: tables, figures and one page out of what the other stages left."""

    preset: str
    domains: tuple[str, ...]
    overrides: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    data: Path
    thesis: Path


class ConfigStageConfig(StageConfig):
    """Stage `config`: composes and validates the configuration of every other stage (see `conf/pipeline.yaml`)."""

    preset: str
    domains: Annotated[tuple[str, ...], AfterValidator(_known_domains)]
    overrides: dict[str, tuple[str, ...]] = Field(default_factory=dict)


SCHEMAS: Mapping[str, type[StageConfig]] = {
    "collect": CollectConfig,
    "fit_transfer": FitTransferConfig,
    "plan": PlanConfig,
    "evaluate_team": EvaluateTeamConfig,
    "report": ReportConfig,
    "config": ConfigStageConfig,
}


def resolve(composed: DictConfig) -> dict[str, Any]:
    """Plain data of a composed configuration; the preset's table of budgets (`experiment`) has done its work and goes.

    Raises:
        ConfigError: an interpolation points nowhere, or a value is missing (`???`).
    """
    try:
        data = cast(dict[str, Any], OmegaConf.to_container(composed, resolve=True, throw_on_missing=True))
    except OmegaConfBaseException as error:
        raise ConfigError(f"configuration: {str(error).splitlines()[0]} (key '{error.full_key or '?'}')") from error
    return {key: value for key, value in data.items() if key not in ("experiment", "hydra")}


def validate(data: Mapping[str, Any], model: type[ModelT], where: str) -> ModelT:
    """A frozen `model` of `data`.

    Args:
        data: plain data.
        model: the schema.
        where: what the message names, e.g. `configuration`.

    Raises:
        ConfigError: one line for each wrong key: what was given and what is allowed.
    """
    try:
        return model.model_validate_json(json.dumps(data))  # strict, and yet a list is a tuple and a text a path
    except ValidationError as error:
        lines = [_line(dict(problem), model) for problem in error.errors(include_url=False, include_context=True)]
    raise ConfigError("\n  ".join([f"{where} refused:", *lines]))


def _line(problem: Mapping[str, Any], model: type[BaseModel]) -> str:
    place = tuple(problem["loc"])
    key = ".".join(str(part) for part in place) or "configuration"
    given = str(problem["input"])
    given = given if len(given) <= 80 else given[:77] + "..."
    if problem["type"] == "extra_forbidden":
        allowed = sorted(_section(model, place[:-1]).model_fields)
        close = get_close_matches(str(place[-1]), allowed, n=1)
        hint = f"did you mean '{close[0]}'? " if close else ""
        return f"{key}: unknown key; {hint}allowed: {', '.join(allowed)}"
    message = str(problem["msg"]).removeprefix("Value error, ")
    if problem["type"] == "missing":
        return f"{key}: missing"
    return f"{key}: {message}" if not place else f"{key}: given {given!r}; {message[0].lower()}{message[1:]}"


def _section(model: type[BaseModel], place: tuple[Any, ...]) -> type[BaseModel]:
    """The nested model at `place`."""
    for part in place:
        field = model.model_fields.get(str(part))
        inner = field.annotation if field else None
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            break
        model = inner
    return model
