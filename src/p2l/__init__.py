"""Plan to Learn: a robot decides what it should learn.

Everything that a person imports, in one place; nothing is loaded before it is used.

Which tasks to teach (thesis, chapter 3): `Problem`, `Plan`, `Decision`, `plan`, `explain`, `read_problem`,
`write_plan`, `read_plan`, `check_certificate`; with copies, robots, limits and a partial order: `Shop`, `read_shop`,
`plan_shop`, `check_shop_plan`; for an uncertain tomorrow: `TwoStage`, `plan_two_stage`, `check_two_stage_plan`; and
facility location for its own sake, `solve_facility_location`.
Which recovery to train next (chapter 4): `SkillGraph` (of `NominalSkill`s), `History`,
`Trained`, `learn`, `make_chooser`.
What skills are learnt in: `make_world`, `make_domain`, and an environment of your own, `GymnasiumWorld`.
What goes wrong there: `discover`; how to recover (chapter 5): `recovery_chaining`, `load_policy`.
What goes wrong because of what was given: `P2LError`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from p2l.gl import forget_missing as _forget_missing_gl

if TYPE_CHECKING:
    from p2l.chaining.front import recovery_chaining
    from p2l.chaining.policy import load_policy
    from p2l.domains.table import make_domain
    from p2l.errors import P2LError
    from p2l.failures.front import discover
    from p2l.metareskill.algorithm import learn
    from p2l.metareskill.choosers.table import make_chooser
    from p2l.metareskill.graph import NominalSkill, SkillGraph
    from p2l.metareskill.history import History, Trained
    from p2l.team.certificate import check_certificate
    from p2l.team.facility import solve_facility_location
    from p2l.team.files import read_problem
    from p2l.team.plan_files import explain, read_plan, write_plan
    from p2l.team.planners import plan
    from p2l.team.problem import Decision, Plan, Problem
    from p2l.team.shop import Shop, check_shop_plan, plan_shop, read_shop
    from p2l.team.tomorrow import TwoStage, check_two_stage_plan, plan_two_stage
    from p2l.worlds.gymnasium import GymnasiumWorld
    from p2l.worlds.table import make_world

_forget_missing_gl()

__version__ = "0.2.0"
__all__ = [
    "Decision",
    "GymnasiumWorld",
    "History",
    "NominalSkill",
    "P2LError",
    "Plan",
    "Problem",
    "Shop",
    "SkillGraph",
    "Trained",
    "TwoStage",
    "__version__",
    "check_certificate",
    "check_shop_plan",
    "check_two_stage_plan",
    "discover",
    "explain",
    "learn",
    "load_policy",
    "make_chooser",
    "make_domain",
    "make_world",
    "plan",
    "plan_shop",
    "plan_two_stage",
    "read_plan",
    "read_problem",
    "read_shop",
    "recovery_chaining",
    "solve_facility_location",
    "write_plan",
]
_HOMES = {
    "p2l.chaining.front": ("recovery_chaining",),
    "p2l.chaining.policy": ("load_policy",),
    "p2l.domains.table": ("make_domain",),
    "p2l.errors": ("P2LError",),
    "p2l.failures.front": ("discover",),
    "p2l.metareskill.choosers.table": ("make_chooser",),
    "p2l.metareskill.graph": ("NominalSkill", "SkillGraph"),
    "p2l.metareskill.history": ("History", "Trained"),
    "p2l.metareskill.algorithm": ("learn",),
    "p2l.team.certificate": ("check_certificate",),
    "p2l.team.facility": ("solve_facility_location",),
    "p2l.team.files": ("read_problem",),
    "p2l.team.plan_files": ("explain", "read_plan", "write_plan"),
    "p2l.team.planners": ("plan",),
    "p2l.team.problem": ("Decision", "Plan", "Problem"),
    "p2l.team.shop": ("Shop", "check_shop_plan", "plan_shop", "read_shop"),
    "p2l.team.tomorrow": ("TwoStage", "check_two_stage_plan", "plan_two_stage"),
    "p2l.worlds.gymnasium": ("GymnasiumWorld",),
    "p2l.worlds.table": ("make_world",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import what is asked for (PEP 562)."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'p2l' has no attribute '{name}'; it has {', '.join(__all__)}")
    attribute = getattr(importlib.import_module(_HOME_OF[name]), name)
    globals()[name] = attribute
    return attribute


def __dir__() -> list[str]:
    return sorted(__all__)
