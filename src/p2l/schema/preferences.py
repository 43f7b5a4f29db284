"""Configuration of `ask`: a person's own tasks, and what is believed of what they cost the person."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from p2l.schema.base import NotNegative, Positive, StageConfig
from p2l.schema.team import ShopFiles


class AskConfig(StageConfig, ShopFiles):
    """Stage `ask`: which question to ask the person next, and the plan without it."""

    tasks: Path
    transfer: Path
    prior: Path
    answers: Path | None
    c_ask: NotNegative
    noise: NotNegative
    points: Annotated[int, Field(ge=1, le=1000)]
    look_ahead: Annotated[int, Field(ge=1, le=3)]
    order: Literal["fixed", "any"] | None
    max_lessons: Annotated[int, Field(ge=0, le=1_000_000)] | None
    max_teaching: NotNegative | None
    reasons_s: NotNegative
    time_limit_s: Positive

    @model_validator(mode="after")
    def _readable(self) -> AskConfig:
        if self.before is not None and self.order is not None:
            raise ValueError(f"order={self.order} and before=…: both say in which order to work; leave one out")
        if str(self.tasks).startswith("-"):
            raise ValueError("tasks=-: the orders are read twice, and standard input can be read once; give a file")
        return self

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Every file that is read."""
        own = (self.tasks, self.transfer, self.prior, self.answers)
        return (*(path for path in own if path is not None), *self.files)

    @property
    def subject(self) -> str:
        """The name of the person's file."""
        return self.tasks.stem

    @property
    def method(self) -> str:
        """How questions are chosen."""
        return "value_of_information"
