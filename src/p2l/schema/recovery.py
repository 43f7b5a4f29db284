"""Configurations of the stages that work on a manipulation world (chapters 4 and 5)."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from p2l.contracts.estimator import Mode
from p2l.failures.strategy import Strategy
from p2l.schema.base import (
    ArchivedStageConfig,
    ChoiceConfig,
    ConfigSection,
    Count,
    NotNegative,
    Positive,
    StageConfig,
)
from p2l.worlds.table import WORLDS

Even = Annotated[int, Field(ge=16, le=1920, multiple_of=2)]
Index = Annotated[int, Field(ge=0)]


class WorldConfig(ChoiceConfig):
    """A manipulation world."""

    registry = WORLDS


class SymbolicWorldConfig(WorldConfig):
    """A world that has symbols, so a skill graph (chapter 4)."""

    @model_validator(mode="after")
    def _check_symbols(self) -> Self:
        factory = WORLDS.factory(self.key)
        factory = factory.func if isinstance(factory, partial) else factory
        if isinstance(factory, type) and not hasattr(factory, "symbols"):
            raise ValueError(f"{factory.__name__} has no symbols, so no skill graph; give it a method `symbols`")
        return self


class WorldStageConfig(StageConfig):
    """Configuration of a stage that works on one world; `item` names its folders: the world, or a variant of it."""

    item: str
    world: WorldConfig

    @property
    def subject(self) -> str:
        """The item."""
        return self.item


class ExecutionsConfig(ConfigSection):
    """Episodes that are run to find training failures, and to find held-out ones."""

    train: Count
    held_out: Count


class DiscoverConfig(WorldStageConfig, ArchivedStageConfig):
    """Stage `discover`: run the nominal skills and keep their failures; `estimator: null` is the strategy's own."""

    strategy: Strategy
    estimator: Mode | None
    executions: ExecutionsConfig
    max_options: Count
    slots: Count

    @property
    def method(self) -> str:
        """The strategy."""
        return self.strategy


class ModesConfig(ConfigSection):
    """Number of modes by strategy of discovery; null lets BIC choose."""

    pessimistic: Count | None
    early_termination: Count | None
    first_flag: Count | None


class VideoConfig(ConfigSection):
    """See `p2l.evaluation.video.player.VideoOptions`."""

    width: Even
    height: Even
    max_frames: Count
    hold_s: NotNegative
    samples: Annotated[int, Field(ge=0, le=16)]


class ClusterConfig(WorldStageConfig, ArchivedStageConfig):
    """Stage `cluster`: group failures into modes, draw them, and film a typical one of each."""

    failures: Path
    held_out: Path
    preconditions: Path | None
    modes: ModesConfig
    max_modes: Count
    covariance: Literal["full", "tied", "diag", "spherical"]
    regularisation: Positive
    restarts: Count
    videos: bool
    video: VideoConfig

    @property
    def method(self) -> str:
        """The only one."""
        return "gmm"


class WatchConfig(WorldStageConfig):
    """Stage `watch`: film a recorded failure, or a nominal run where none is given.

    With `policy`, the folder of a recovery policy: that failure, or the first that nominal runs meet, beside what the
    policy does about it.
    """

    failure: Index | None
    failures: Path
    policy: Path | None
    transfer: bool
    video: VideoConfig

    @property
    def method(self) -> str:
        """What the video shows."""
        name = "nominal" if self.failure is None else f"failure{self.failure}"
        if self.policy is None:
            return name
        return "recovery" if self.failure is None else f"{name}-recovery"
