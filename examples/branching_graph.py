"""MetaReSkill where several ways lead to the goal, and one of them is worth taking only once its failures are mended.

    python -m examples.branching_graph

A part can be thrown into its box, which drops it in four of ten, or carried and placed. Dropped parts can be picked up
again, once somebody has trained that. `train` stands for your own: it may do anything that ends in a success rate.
"""

from __future__ import annotations

import numpy as np

from p2l import History, NominalSkill, SkillGraph, Trained, learn, make_chooser
from p2l.metareskill.value_iteration import best_skills

START, AT_BOX, GOAL = 0, 1, 2
DROPPED, JAMMED = 0, 1
SKILLS = (
    NominalSkill("throw", START, {GOAL: 0.6}, falls={DROPPED: 0.4}),
    NominalSkill("carry", START, {AT_BOX: 0.9}),
    NominalSkill("place", AT_BOX, {GOAL: 0.8}, falls={JAMMED: 0.15}),
)
CEILING = np.array([[0.95, 0.3, 0.0], [0.2, 0.6, 0.1]])  # [mode, target]: what training can reach


def train(mode: int, target: int, trainings: int) -> Trained:
    """Train the recovery from a failure mode to a target once more; `trainings` counts those before."""
    return Trained(q=float(CEILING[mode, target] * (1.0 - 0.5 ** (trainings + 1))), trials=20)


def main() -> History:
    """Print which way the robot takes before and after training, and what was trained."""
    graph = SkillGraph.of_skills(2, SKILLS, sizes=np.array([40.0, 15.0]))
    chooser = make_chooser("metareskill", {"initial_rounds": 2})
    *_, history = learn(graph, chooser, train, rounds=18, rng=np.random.default_rng(0))
    print(f"at the start, before: {best_skills(graph)[START]}; after: {best_skills(graph.with_q(history.best))[START]}")
    print(f"value of failures {history.rounds[-1].value:.2f}; trainings by mode and target:\n{history.counts}")
    return history


if __name__ == "__main__":
    main()
