"""Configurations of the stages that see the whole pipeline: `config` and `report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from p2l.domains.table import DOMAINS
from p2l.errors import P2LError
from p2l.schema.base import StageConfig


def _check_domains(names: tuple[str, ...]) -> tuple[str, ...]:
    if not names:
        raise ValueError("name at least one domain")
    try:
        return tuple(DOMAINS.check(name) for name in names)
    except P2LError as error:
        raise ValueError(str(error)) from None


class ItemsConfig(StageConfig):
    """What the pipeline runs (see `conf/pipeline.yaml`): `worlds` are names of files in `conf/world/`.

    `recovery_worlds` are those of them that go on to chapter 4's stages, `cluster_worlds` all others, whose failures
    are grouped as they were found; `chain_worlds` are those that go on to chapter 5's.
    """

    preset: str
    domains: tuple[str, ...]
    worlds: tuple[str, ...]
    cluster_worlds: tuple[str, ...]
    recovery_worlds: tuple[str, ...]
    chain_worlds: tuple[str, ...]
    overrides: dict[str, tuple[str, ...]] = Field(default_factory=dict)


class ReportConfig(ItemsConfig):
    """Stage `report`: tables, figures and one page out of what the other stages left."""

    data: Path
    thesis: Path
    results: Path


class ConfigStageConfig(ItemsConfig):
    """Stage `config`: composes and validates the configuration of every other stage."""

    domains: Annotated[tuple[str, ...], AfterValidator(_check_domains)]

    @model_validator(mode="after")
    def _no_item_twice(self) -> ConfigStageConfig:
        items = [*self.domains, *self.worlds]
        if twice := sorted({item for item in items if items.count(item) > 1}):
            raise ValueError(f"domains and worlds name {', '.join(twice)} twice; none twice, for each has one folder")
        for kind in ("cluster_worlds", "recovery_worlds", "chain_worlds"):
            names: tuple[str, ...] = getattr(self, kind)
            if apart := [world for world in names if world not in self.worlds]:
                raise ValueError(f"{kind} names {', '.join(apart)}; worlds has: {', '.join(self.worlds) or 'none'}")
            if len(set(names)) < len(names):
                raise ValueError(f"{kind} names a world twice")
        groups = {*self.cluster_worlds, *self.recovery_worlds}
        if both := [world for world in self.cluster_worlds if world in self.recovery_worlds]:
            raise ValueError(f"cluster_worlds and recovery_worlds both name {', '.join(both)}; one of them groups it")
        if rest := [world for world in self.worlds if world not in groups]:
            raise ValueError(f"neither cluster_worlds nor recovery_worlds names {', '.join(rest)}, which worlds has")
        return self
