"""The choosers that are compared, by name.

A new one of ours is a function, its line here and a YAML in `conf/chooser/`; one of another package needs the YAML
alone (`p2l.registry`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from p2l.errors import ConfigError
from p2l.metareskill.choosers import bandits, lookahead, oracle, rules, trends
from p2l.metareskill.choosers.contract import Chooser, Rule, check_number
from p2l.registry import Registry

CHOOSERS: Registry[Callable[..., Rule]] = Registry(
    "chooser",
    {
        "metareskill": lambda: rules.metareskill,
        "lookahead": lambda: lookahead.lookahead,
        "round_robin": lambda: rules.round_robin,
        "weighted_round_robin": lambda: rules.weighted_round_robin,
        "ucb1": lambda: bandits.ucb1,
        "thompson": lambda: bandits.thompson,
        "extrapolation": lambda: trends.extrapolation,
        "rising": lambda: trends.rising,
        "oracle": lambda: oracle.oracle,
    },
)


def make_chooser(name: str, params: Mapping[str, Any] | None = None) -> Chooser:
    """A chooser by name, or by target (`package.module:function`).

    Args:
        name: of the chooser.
        params: settings of its factory, and `initial_rounds`, which every chooser takes (0 if not given).

    Raises:
        ConfigError: unknown chooser, or a setting that it does not take or refuses.

    Example:
        >>> from p2l import make_chooser
        >>> make_chooser("metareskill", {"initial_rounds": 2, "window": 3}).initial_rounds
        2
    """
    settings = dict(params or {})
    factory = CHOOSERS.factory_for(name, settings, also=["initial_rounds"])
    initial_rounds = settings.pop("initial_rounds", 0)
    check_number(f"{name}: initial_rounds", initial_rounds, low=0, whole=True)
    with CHOOSERS.given(name, factory, settings):
        rule = factory(**settings)
    if not callable(rule):
        raise ConfigError(f"chooser '{name}': makes a {type(rule).__name__}, which is no rule; see docs/recoveries.md")
    return Chooser(name, rule, initial_rounds)
