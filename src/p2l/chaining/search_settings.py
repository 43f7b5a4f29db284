"""Settings of the learner that searches."""

from __future__ import annotations

from dataclasses import dataclass, fields

from p2l.errors import ConfigError


@dataclass(frozen=True)
class SearchSettings:
    """How much is tried before the model is fitted again, and what the network learns from.

    Attributes:
        trials: of a round.
        portfolio: macros that the model chooses among: those that recovered from most of the failures they met.
        longest: most primitives of a macro.
        updates: of the network, for each evaluation.
        batch: decisions of an update.
        executions: of the nominal skills in each further world that the search practises in, to find failures.

    Raises:
        ConfigError: one of them is not a positive whole number.
    """

    trials: int = 200
    portfolio: int = 60
    longest: int = 8
    updates: int = 2000
    batch: int = 128
    executions: int = 300

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not isinstance(value, int) or isinstance(value, bool) or value < 1:
                raise ConfigError(f"search: {each.name} must be an integer of at least 1, got {value!r}")
