"""How failures are looked for; `discovery` says what each strategy does."""

from __future__ import annotations

from typing import Literal, get_args

from p2l.contracts.estimator import Mode

Strategy = Literal["pessimistic", "early_termination", "first_flag"]
STRATEGIES: tuple[str, ...] = get_args(Strategy)
# The estimator that each strategy assumes; None leaves the world its own.
ESTIMATORS: dict[Strategy, Mode | None] = {
    "pessimistic": "fixed",
    "early_termination": "halving",
    "first_flag": None,
}
