"""The sections of the report, in order. A new part of the thesis adds its module's sections here."""

from __future__ import annotations

from collections.abc import Callable

from p2l.evaluation.chaining import reuse_section as chain_reuse
from p2l.evaluation.chaining import section as chains
from p2l.evaluation.failures import section as failures
from p2l.evaluation.metareskill import section as recoveries
from p2l.evaluation.metareskill import strategies
from p2l.evaluation.objective_section import one_objective
from p2l.evaluation.page.page import Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.team import section as chapter3
from p2l.evaluation.team import uncertain_section as uncertain
from p2l.evaluation.transfer import section as worlds

SECTIONS: tuple[Callable[[Sources], Section], ...] = (
    chapter3.in_one_picture,
    one_objective,
    worlds.learnt_skills,
    worlds.predictors,
    chapter3.figure_3_7,
    chapter3.table_3_1,
    chapter3.table_3_2,
    chapter3.figure_3_10,
    chapter3.order_any,
    chapter3.prediction_price,
    *uncertain.SECTIONS,
    failures.nominal_skills,
    failures.modes,
    recoveries.preconditions,
    recoveries.learning,
    strategies.curves,
    strategies.table_4_1,
    strategies.within,
    strategies.table_4_2,
    *chains.SECTIONS,
    *chain_reuse.SECTIONS,
)
