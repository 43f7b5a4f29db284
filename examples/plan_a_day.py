"""Plan a day from Python: which tasks to teach, which to do, which to hand over, and why.

    python -m examples.plan_a_day

Four tasks in work order: three brackets that resemble one another, and a gear that the robot knows already.
"""

from __future__ import annotations

import numpy as np

from p2l import Decision, Plan, Problem, check_certificate, explain, plan


def todays_problem() -> Problem:
    """Costs in any one unit of effort; row i of `transfer`: how well a lesson on task i carries over to each task."""
    alike = np.full((4, 4), 0.90) + 0.05 * np.eye(4)
    alike[3, :3] = alike[:3, 3] = 0.05
    return Problem(
        tasks=("bracket_a", "bracket_b", "bracket_c", "gear"),
        c_rob=np.full(4, 10.0),
        c_hum=np.full(4, 100.0),
        c_fail=np.full(4, 100.0),
        c_demo=np.full(4, 200.0),
        pretrained=np.array([0.10, 0.10, 0.10, 0.95]),
        transfer=alike,
    )


def main() -> Plan:
    """Plan, check the proof, and print the reasons."""
    problem = todays_problem()
    day = plan(problem)
    verdict = check_certificate(problem, day)
    print(explain(problem, day))
    print(f"Checked without the solver: cost {verdict.cost:.1f}, no plan costs less than {verdict.bound:.1f}.")
    print("Lessons:", [name for name, what in zip(problem.tasks, day.decision, strict=True) if what == Decision.LEARN])
    return day


if __name__ == "__main__":
    main()
