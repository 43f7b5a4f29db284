"""What every configuration obeys, and how one is checked: types, ranges, one message that names every wrong key."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, cast, get_args

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_serializer,
)

from p2l.artifacts import config_hash
from p2l.closure import outside_code
from p2l.errors import ConfigError, P2LError
from p2l.registry import TARGET, Registry

Count = Annotated[int, Field(ge=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Probability = Annotated[float, Field(ge=0, le=1)]
ModelT = TypeVar("ModelT", bound=BaseModel)
_NAME = re.compile(r"\w[\w.-]*")


class ConfigSection(BaseModel):
    """Part of a configuration: frozen, no unknown keys, no NaN or infinity, no number written as text."""

    # Of the models of a module, a stage uses a few; each is built when it is first used.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True)


class ChoiceConfig(ConfigSection):
    """Something chosen by name: of ours, or `target: package.module:attribute` of another package.

    `params` go to its factory, which refuses those it does not know; `name` stands for it in tables and folders.
    """

    registry: ClassVar[Registry[Any]]

    target: Annotated[str | None, Field(validate_default=True)] = None
    name: str
    params: dict[str, Any] = Field(default_factory=dict)

    @property
    def key(self) -> str:
        """Its key in the registry."""
        return self.target or self.name

    @property
    def outside(self) -> str | None:
        """Module that holds its factory, if that is not ours."""
        target = self.registry.target(self.key)
        return target and target.partition(":")[0]

    @field_validator("target")
    @classmethod
    def _check_target(cls, target: str | None) -> str | None:
        if target is not None and not TARGET.fullmatch(target):
            raise ValueError("it is no target; write 'package.module:attribute'")
        return None if target is None else _check_registry(cls.registry, target)

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str, info: ValidationInfo) -> str:
        if "target" not in info.data:  # it is wrong, and the name may be right
            return name
        if info.data["target"] is None:
            return _check_registry(cls.registry, name)
        if not _NAME.fullmatch(name):
            raise ValueError("it stands in names of folders; use letters, digits, '_', '-' and '.'")
        if name in cls.registry.names():
            raise ValueError("it is the name of one that is there already; choose another for what `target` names")
        return name

    @model_serializer(mode="wrap")
    def _without_absent_target(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A configuration that names no target is the same as before there were any."""
        values: dict[str, Any] = plain(self)
        return {key: values[key] for key in ("name", *values) if key != "target" or values[key] is not None}


def _choices(value: object) -> Iterator[ChoiceConfig]:
    """Everything in a configuration that is chosen by name."""
    if isinstance(value, ChoiceConfig):
        yield value
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _choices(getattr(value, name))
    elif isinstance(value, Mapping):
        for each in value.values():
            yield from _choices(each)


def _check_registry(registry: Registry[Any], key: str) -> str:
    try:
        return registry.check(key)
    except P2LError as error:
        raise ValueError(str(error)) from None


class TrackingConfig(ConfigSection):
    """Where metrics go; `uri: null` means `MLFLOW_TRACKING_URI`, else the repository's own sqlite store."""

    enabled: bool = True
    uri: str | None = None


class StageConfig(ConfigSection):
    """What every stage's configuration holds."""

    idle: ClassVar[dict[str, Any]] = {"tracking": True, "world": {"params": {"nthread"}}}  # what changes no result

    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    tracking: TrackingConfig = TrackingConfig()

    @property
    def hash(self) -> str:
        """Identifies the work: hash of everything but what changes no result, `tracking` and the world's `nthread`.

        The code of what is not ours is part of it. Checkpoints carry it in their names.
        """
        values = self.model_dump(mode="json", exclude=self.idle)
        return config_hash([values, code] if (code := self.outside_code) else values)

    @property
    def outside_code(self) -> str:
        """Hash of the code of the worlds, learners and choosers that are not ours; empty if all are."""
        return outside_code(sorted({module for choice in _choices(self) if (module := choice.outside)}))

    @property
    def subject(self) -> str:
        """What it works on, in run names and tags."""
        return "all"

    @property
    def method(self) -> str:
        """The method's name in run names and tags."""
        return "all"


class ArchivedStageConfig(StageConfig):
    """Configuration of a stage whose files are kept in `records`, and taken from there; null keeps none."""

    idle: ClassVar[dict[str, Any]] = StageConfig.idle | {"records": True}

    records: Path | None = None


def paths_of(schema: type[StageConfig]) -> frozenset[str]:
    """The fields that name a file or a folder."""
    fields = schema.model_fields.items()
    return frozenset(name for name, field in fields if field.annotation is Path or Path in get_args(field.annotation))


def resolve(config: DictConfig) -> dict[str, Any]:
    """Plain data of a composed configuration; the preset's table of budgets (`experiment`) has done its work and goes.

    Raises:
        ConfigError: an interpolation points nowhere, or a value is missing (`???`).
    """
    try:
        data = cast(dict[str, Any], OmegaConf.to_container(config, resolve=True, throw_on_missing=True))
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


def unknown_key(key: str, model: type[BaseModel]) -> str | None:
    """What to say of a key (dotted) that a schema does not know; None where it knows it, or leaves it open."""
    for part in key.split("."):
        field = model.model_fields.get(part)
        if field is None:
            return f"{key}: {_unknown(part, model)}"
        if not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
            return None
        model = field.annotation
    return None


def _unknown(name: str, model: type[BaseModel]) -> str:
    keys = sorted(model.model_fields)
    close = get_close_matches(name, keys, n=1)
    hint = f"did you mean '{close[0]}'? " if close else ""
    return f"unknown key; {hint}allowed: {', '.join(keys)}"


def _line(problem: Mapping[str, Any], model: type[BaseModel]) -> str:
    place = tuple(problem["loc"])
    key = ".".join(str(part) for part in place) or "configuration"
    value = str(problem["input"])
    value = value if len(value) <= 80 else value[:77] + "..."
    if problem["type"] == "extra_forbidden":
        return f"{key}: {_unknown(str(place[-1]), _section(model, place[:-1]))}"
    message = str(problem["msg"]).removeprefix("Value error, ")
    if problem["type"] == "missing":
        return f"{key}: missing"
    return f"{key}: {message}" if not place else f"{key}: given {value!r}; {message[0].lower()}{message[1:]}"


def _section(model: type[BaseModel], place: tuple[Any, ...]) -> type[BaseModel]:
    """The nested model at `place`."""
    for part in place:
        field = model.model_fields.get(str(part))
        inner = field.annotation if field else None
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            break
        model = inner
    return model
