"""Configuration of `day`: a plan's day as it happens."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from p2l.schema.base import Positive, StageConfig


class DayConfig(StageConfig):
    """Stage `day`: the plan of a person's own tasks, and what happened; see `p2l.team.day.SkillPrior`."""

    plan: Path
    outcomes: Path | None
    prior_n: Annotated[float, Field(gt=0, le=1e6)]
    spread: Annotated[float, Field(ge=0, le=10)]
    time_limit_s: Positive

    @property
    def subject(self) -> str:
        """The folder of the plan."""
        return self.plan.resolve().name

    @property
    def method(self) -> str:
        """The only one."""
        return "replanning"
