"""Errors that a person can act on.

Every error says what was given, what is allowed and what to do. Stages turn a `P2LError` into one message on
standard error and exit code 2; anything else is a bug and keeps its traceback.
"""

from __future__ import annotations

from pathlib import Path


class P2LError(Exception):
    """Base of all errors that the input, the configuration or the surroundings cause.

    Example:
        >>> from p2l import P2LError, make_chooser
        >>> try:
        ...     make_chooser("gut_feeling")
        ... except P2LError as error:
        ...     print(error)  # doctest: +ELLIPSIS
        unknown chooser 'gut_feeling'; known: extrapolation, lookahead, metareskill, ...
    """

    exit_code = 2


class ConfigError(P2LError):
    """A configuration value is missing, unknown or out of range."""


class InputError(P2LError):
    """A person's file is wrong; the message names the file, the row and the field."""

    @classmethod
    def at(cls, path: Path | str, row: str | int | None, field: str | None, problem: str) -> InputError:
        """Build the message `<file>, row <row>, column '<field>': <problem>`, leaving out what is None."""
        place = [str(path)]
        if row is not None:
            place.append(f"row {row}")
        if field is not None:
            place.append(f"column '{field}'")
        return cls(f"{', '.join(place)}: {problem}")


class ArtifactError(P2LError):
    """An artifact is missing, damaged, of another schema, or belongs to another configuration."""


class ShapeError(P2LError):
    """An array does not have the shape, type or range that its record demands."""


class SolverError(P2LError):
    """A solver proved infeasibility, found no plan in time, or was asked for something it cannot do."""


class TrackingError(P2LError):
    """The experiment tracker cannot be reached or refuses to write."""
