"""What may come tomorrow, as the stages `plan` and `check_plan` are told of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from p2l.schema.base import ConfigSection


class FutureFiles(ConfigSection):
    """Tables of tomorrow: futures, or expected numbers, and the tasks that may come where these are not today's."""

    scenarios: Path | None = None
    forecast: Path | None = None
    tomorrow: Path | None = None

    @property
    def future_files(self) -> tuple[Path, ...]:
        """Those that are given."""
        return tuple(path for path in (self.scenarios, self.forecast, self.tomorrow) if path is not None)

    @property
    def has_future(self) -> bool:
        """Whether more than today is planned."""
        return self.scenarios is not None or self.forecast is not None

    @model_validator(mode="after")
    def _one_future(self) -> FutureFiles:
        if self.scenarios is not None and self.forecast is not None:
            raise ValueError("scenarios=… and forecast=…: give one of them, futures or expected numbers")
        if self.tomorrow is not None and not self.has_future:
            raise ValueError("tomorrow=… says which tasks may come; give scenarios=… or forecast=…, which say how many")
        return self


class FutureConfig(FutureFiles):
    """What can be decided tomorrow, and how many samples of it are drawn.

    `replications` is 10 for a forecast if none is given, and 0 for scenarios, which are then taken as they are.
    """

    commit: Literal["today", "all"] = "today"
    samples: Annotated[int, Field(ge=1, le=100_000)] = 200
    replications: Annotated[int, Field(ge=0, le=1000)] | None = None

    @property
    def repeats(self) -> int:
        """How often the plan is compared with the best one of a sample."""
        default = 10 if self.forecast is not None else 0
        return default if self.replications is None else self.replications

    @model_validator(mode="after")
    def _only_for_a_future(self) -> FutureConfig:
        changes = {"commit": self.commit != "today", "replications": self.replications is not None}
        if not self.has_future and any(changes.values()):
            names = ", ".join(name for name, change in changes.items() if change)
            raise ValueError(f"{names}: only with scenarios=… or forecast=…")
        if self.replications == 1:
            raise ValueError("replications=1: an interval needs at least two; give 0 for none")
        return self
