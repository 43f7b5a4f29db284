"""The day as it happens: outcomes are entered, what was learnt is believed anew, the rest is planned again (6.2.1).

Read `record` (what a day is), then `skills` (what outcomes say of a lesson), `remaining` (the shop that is left) and
`advance` (one outcome after another). `change` tells what a plan anew is about, `files` keeps a day on disk.
"""

from p2l.team.day.advance import advance, begin, replan
from p2l.team.day.change import Change, change_of, explain_change
from p2l.team.day.record import Day, Event, EventError, EventOutcome, Step
from p2l.team.day.remaining import Rest, remaining_shop
from p2l.team.day.skills import SkillPrior
from p2l.team.day.steps import next_step, planned_step

__all__ = [
    "Change",
    "Day",
    "Event",
    "EventError",
    "EventOutcome",
    "Rest",
    "SkillPrior",
    "Step",
    "advance",
    "begin",
    "change_of",
    "explain_change",
    "next_step",
    "planned_step",
    "remaining_shop",
    "replan",
]
