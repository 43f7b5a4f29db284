"""The large-scale route: facility location by bounds, search and branching (thesis, theorem 3.4.1).

This is the room's door: others import from here, not from the modules inside. What needs numba or HiGHS is imported
when it is first asked for, so importing the room costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from p2l.team.facility.location import large_scale, solve_facility_location, solve_small_or_large, within_limits
from p2l.team.facility.orlib import read_instance
from p2l.team.facility.pairs import Pairs, PairsSolution, collect, of_table
from p2l.team.facility.reduction import lesson_costs, of_problem

if TYPE_CHECKING:
    from p2l.team.facility.greedy import guarantee
    from p2l.team.facility.program import ProgramSolution, relaxation, solve_program
    from p2l.team.facility.solve import dual_ascent_lessons, greedy_lessons, load_kernels, solve_pairs

__all__ = [
    "Pairs",
    "PairsSolution",
    "ProgramSolution",
    "collect",
    "dual_ascent_lessons",
    "greedy_lessons",
    "guarantee",
    "large_scale",
    "lesson_costs",
    "load_kernels",
    "of_problem",
    "of_table",
    "read_instance",
    "relaxation",
    "solve_facility_location",
    "solve_pairs",
    "solve_program",
    "solve_small_or_large",
    "within_limits",
]


def __getattr__(name: str) -> Any:
    """What is imported on first use; as statements, since `p2l.closure` reads what a stage depends on from them."""
    if name in ("ProgramSolution", "relaxation", "solve_program"):
        from p2l.team.facility import program

        return getattr(program, name)
    if name == "guarantee":
        from p2l.team.facility import greedy

        return getattr(greedy, name)
    if name in ("dual_ascent_lessons", "greedy_lessons", "load_kernels", "solve_pairs"):
        from p2l.team.facility import solve

        return getattr(solve, name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
