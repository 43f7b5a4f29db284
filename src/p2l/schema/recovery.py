"""Configurations of the stages that work on a manipulation world (chapters 4 and 5)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from p2l.contracts.estimator import Mode
from p2l.failures.strategy import Strategy
from p2l.registry import described_worlds, known_worlds
from p2l.schema.base import Count, NotNegative, Positive, Section, StageConfig

Even = Annotated[int, Field(ge=16, le=1920, multiple_of=2)]
Index = Annotated[int, Field(ge=0)]


def known_world(name: str) -> str:
    """Refuse a world that is not registered."""
    if name not in known_worlds():
        raise ValueError(f"unknown world; allowed: {', '.join(known_worlds())}")
    return name


def described_world(name: str) -> str:
    """Refuse a world that has no skill graph."""
    if name not in described_worlds():
        raise ValueError(f"no symbols, so no skill graph; worlds that have: {', '.join(described_worlds())}")
    return name


class WorldConfig(Section):
    """A registered manipulation world; `params` go to its constructor, which refuses those it does not know."""

    name: Annotated[str, AfterValidator(known_world)]
    params: dict[str, Any] = Field(default_factory=dict)


class DescribedWorldConfig(WorldConfig):
    """A registered world that has symbols, so a skill graph (chapter 4)."""

    name: Annotated[str, AfterValidator(known_world), AfterValidator(described_world)]


class WorldStageConfig(StageConfig):
    """Configuration of a stage that works on one world; `item` names its folders: the world, or a variant of it."""

    item: str
    world: WorldConfig

    @property
    def subject(self) -> str:
        """The item."""
        return self.item


class ExecutionsConfig(Section):
    """Episodes that are run to find training failures, and to find held-out ones."""

    train: Count
    held_out: Count


class DiscoverConfig(WorldStageConfig):
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


class ModesConfig(Section):
    """Number of modes by strategy of discovery; null lets BIC choose."""

    pessimistic: Count | None
    early_termination: Count | None
    first_flag: Count | None


class VideoConfig(Section):
    """See `p2l.evaluation.video.player.VideoOptions`."""

    width: Even
    height: Even
    max_frames: Count
    hold_s: NotNegative
    samples: Annotated[int, Field(ge=0, le=16)]


class ClusterConfig(WorldStageConfig):
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
        """What is shown."""
        shown = "nominal" if self.failure is None else f"failure{self.failure}"
        if self.policy is None:
            return shown
        return "recovery" if self.failure is None else f"{shown}-recovery"
