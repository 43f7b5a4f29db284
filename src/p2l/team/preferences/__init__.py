"""A person whose costs are not known: what is believed of them, what to ask, and when to stop (thesis, section 6.2.2).

Read `record`, then `belief` (what an answer changes), `values` (what it is worth) and `dialogue` (asking until nothing
is worth its cost). `people` are made up, to compare ways of asking.
"""

from p2l.team.preferences.belief import (
    after_answer,
    expected_shop,
    gamma_prior,
    listed_prior,
    lognormal_prior,
    possible_answers,
)
from p2l.team.preferences.dialogue import Dialogue, ask
from p2l.team.preferences.record import CostPrior, Kinds, Preferences
from p2l.team.preferences.values import QuestionValue, next_question, question_values

__all__ = [
    "CostPrior",
    "Dialogue",
    "Kinds",
    "Preferences",
    "QuestionValue",
    "after_answer",
    "ask",
    "expected_shop",
    "gamma_prior",
    "listed_prior",
    "lognormal_prior",
    "next_question",
    "possible_answers",
    "question_values",
]
